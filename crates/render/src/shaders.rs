//! The shaders' text. Shared parts come first; one module a pass.

/// Find which tiles of rays may see something, and where.
pub(crate) const TILES: &str = concat!(
    include_str!("../../../shaders/common/frame.wgsl"),
    include_str!("../../../shaders/common/tiles.wgsl"),
    include_str!("../../../shaders/common/field.wgsl"),
    include_str!("../../../shaders/tiles.wgsl"),
);

/// Ray-cast both eyes: in steps (`raycast`), without (`exact`), or labels, voxel by voxel (`labels`).
pub(crate) const RAYCAST: &str = concat!(
    include_str!("../../../shaders/common/frame.wgsl"),
    include_str!("../../../shaders/common/tiles.wgsl"),
    include_str!("../../../shaders/common/field.wgsl"),
    include_str!("../../../shaders/raycast.wgsl"),
    include_str!("../../../shaders/exact.wgsl"),
    include_str!("../../../shaders/labels.wgsl"),
);

/// Convert the picture to YUV 4:2:0.
pub(crate) const CONVERT: &str = concat!(
    include_str!("../../../shaders/common/frame.wgsl"),
    include_str!("../../../shaders/convert.wgsl"),
);

/// Reduce the depths to a coarse grid.
pub(crate) const DEPTH: &str =
    concat!(include_str!("../../../shaders/common/frame.wgsl"), include_str!("../../../shaders/depth.wgsl"),);

#[cfg(test)]
mod tests {
    use super::*;

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
