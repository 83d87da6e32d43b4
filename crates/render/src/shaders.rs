//! The shaders' text. Shared parts come first; one module a pass.

/// Find which tiles of rays may see something, and where.
pub(crate) const TILES: &str = concat!(
    include_str!("../../../shaders/common/frame.wgsl"),
    include_str!("../../../shaders/common/tiles.wgsl"),
    include_str!("../../../shaders/common/field.wgsl"),
    include_str!("../../../shaders/tiles.wgsl"),
);

/// Ray-cast both eyes: in steps (`raycast`), without (`exact`), labels, voxel by voxel (`labels`), or reading and nothing
/// else (`bare`).
pub(crate) const RAYCAST: &str = concat!(
    include_str!("../../../shaders/common/frame.wgsl"),
    include_str!("../../../shaders/common/tiles.wgsl"),
    include_str!("../../../shaders/common/field.wgsl"),
    include_str!("../../../shaders/raycast.wgsl"),
    include_str!("../../../shaders/exact.wgsl"),
    include_str!("../../../shaders/labels.wgsl"),
    include_str!("../../../shaders/bare.wgsl"),
);

/// Convert the picture to YUV 4:2:0.
pub(crate) const CONVERT: &str = concat!(
    include_str!("../../../shaders/common/frame.wgsl"),
    include_str!("../../../shaders/convert.wgsl"),
);

/// Reduce the depths to a coarse grid.
pub(crate) const DEPTH: &str =
    concat!(include_str!("../../../shaders/common/frame.wgsl"), include_str!("../../../shaders/depth.wgsl"),);

/// A shader's text without what constants rule out: of each `if (NAME)` and `if (MODE == NAME)` only the branch that is
/// taken stays.
pub(crate) fn cut(text: &str, constants: &[(&str, f64)]) -> String {
    let value = |name: &str| constants.iter().find(|(n, _)| *n == name).map(|(_, value)| *value);
    let number = |name: &str| {
        let at = text.find(&format!("const {name}: u32 = "))?;
        text[at..].split(" = ").nth(1)?.split('u').next()?.parse::<f64>().ok()
    };
    cut_part(text, &|condition| match condition.split_once(" == ") {
        Some((left, right)) => Some(value(left)? == number(right)?),
        None => value(condition).map(|v| v != 0.0),
    })
}

/// The same for a part of a text; `decided` says of a condition whether it holds, if that is known.
fn cut_part(text: &str, decided: &dyn Fn(&str) -> Option<bool>) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find("if (") {
        let (before, from) = rest.split_at(at);
        out += before;
        let condition = from["if (".len()..].split_once(')');
        let Some((holds, behind)) = condition.and_then(|(c, behind)| Some((decided(c)?, behind))) else {
            out += "if (";
            rest = &from["if (".len()..];
            continue;
        };
        let (body, behind) = block(behind);
        let (other, behind) = match behind.trim_start().strip_prefix("else").map(str::trim_start) {
            Some(next) if next.starts_with("if") => chain(next),
            Some(next) => block(next),
            None => ("", behind),
        };
        // A branch may end in `return`, and nothing may stand behind that in the same block.
        out += "if (true) {";
        out += &cut_part(if holds { body } else { other }, decided);
        out += "}";
        rest = behind;
    }
    out + rest
}

/// What stands in the braces that a text begins with, and what follows them.
fn block(text: &str) -> (&str, &str) {
    let open = text.find('{').unwrap_or(text.len());
    let mut depth = 0;
    for (at, c) in text.char_indices().skip_while(|(at, _)| *at < open) {
        depth += i32::from(c == '{') - i32::from(c == '}');
        if depth == 0 {
            return (&text[open + 1..at], &text[at + 1..]);
        }
    }
    (text, "")
}

/// An `if` with all its `else`, and what follows.
fn chain(text: &str) -> (&str, &str) {
    let (_, mut behind) = block(text);
    while let Some(next) = behind.trim_start().strip_prefix("else") {
        behind = block(next).1;
    }
    text.split_at(text.len() - behind.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_constants_rule_out_is_cut() {
        let text = "const A: u32 = 0u; const B: u32 = 1u; f(); if (LIT) { x(); } else { y(); } \
            if (MODE == A) { a(); } else if (MODE == B) { if (LIT) { l(); } if (z > 0) { b(); } } else { c(); } g();";
        let squeezed = |t: String| t.replace("if (true)", "").split_whitespace().collect::<String>();
        let of = |lit: f64, mode: f64| squeezed(cut(text, &[("LIT", lit), ("MODE", mode)]));
        let head = "constA:u32=0u;constB:u32=1u;f();";
        assert_eq!(of(0.0, 0.0), format!("{head}{{y();}}{{a();}}g();"));
        assert_eq!(of(1.0, 1.0), format!("{head}{{x();}}{{{{{{l();}}if(z>0){{b();}}}}}}g();"));
        assert_eq!(of(0.0, 2.0), format!("{head}{{y();}}{{{{c();}}}}g();"));
    }

    #[test]
    fn a_cut_ray_caster_is_valid_and_knows_nothing_of_what_is_not_used() {
        for mode in 0..5 {
            for bits in 0..16 {
                let flag = |bit: u32| f64::from(bits >> bit & 1);
                let constants = [
                    ("MODE", f64::from(mode)),
                    ("LIT", flag(0)),
                    ("SKIP", flag(1)),
                    ("EXACT_FILTER", flag(2)),
                    ("COUNT", flag(3)),
                ];
                let text = cut(RAYCAST, &constants);
                validate(&format!("mode {mode}, {bits:04b}"), &text);
                for gone in ["if (LIT)", "if (SKIP)", "if (EXACT_FILTER)", "if (COUNT)", "if (MODE =="] {
                    assert!(!text.contains(gone), "{gone}");
                }
            }
        }
    }

    fn validate(name: &str, text: &str) {
        let module = naga::front::wgsl::parse_str(text)
            .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(text)));
        naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::empty())
            .validate(&module)
            .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(text)));
    }

    #[test]
    fn every_shader_is_valid_without_optional_features() {
        for (name, text) in [("tiles", TILES), ("raycast", RAYCAST), ("convert", CONVERT), ("depth", DEPTH)] {
            validate(name, text);
        }
    }

    #[test]
    fn every_shader_file_is_used() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shaders");
        let all = [TILES, RAYCAST, CONVERT, DEPTH].concat();
        let mut folders = vec![std::path::PathBuf::from(folder)];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    folders.push(path);
                } else {
                    assert!(
                        all.contains(&std::fs::read_to_string(&path).unwrap()),
                        "{} is unused",
                        path.display()
                    );
                }
            }
        }
    }
}
