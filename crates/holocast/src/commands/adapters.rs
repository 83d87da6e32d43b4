//! `holocast adapters`.

use crate::terminal::say;
use ::render::Gpu;
use anyhow::bail;

pub(crate) fn run(json: bool) -> anyhow::Result<()> {
    let adapters = Gpu::adapters();
    if json {
        let rows: Vec<_> = adapters
            .iter()
            .map(|a| {
                serde_json::json!({"name": a.name, "kind": a.kind, "driver": a.driver, "software": a.is_software})
            })
            .collect();
        say(serde_json::to_string_pretty(&rows)?);
    } else if adapters.is_empty() {
        bail!(::render::OpenError::NoAdapter);
    } else {
        for adapter in adapters {
            say(adapter);
        }
    }
    Ok(())
}
