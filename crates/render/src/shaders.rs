//! The shaders' text. Shared parts come first; one module a pass.

use scene::MOST_VOLUMES;

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
    include_str!("../../../shaders/common/cubic.wgsl"),
    include_str!("../../../shaders/raycast.wgsl"),
    include_str!("../../../shaders/exact.wgsl"),
    include_str!("../../../shaders/labels.wgsl"),
    include_str!("../../../shaders/bare.wgsl"),
);

/// Interpolate pixels between rays, and list those that need rays of their own.
pub(crate) const SPREAD: &str = concat!(
    include_str!("../../../shaders/common/frame.wgsl"),
    include_str!("../../../shaders/common/tiles.wgsl"),
    include_str!("../../../shaders/spread.wgsl"),
);

/// What [`several_tiles`] is made of.
const SEVERAL_TILES: &str = concat!(
    include_str!("../../../shaders/common/frame.wgsl"),
    include_str!("../../../shaders/common/tiles.wgsl"),
    include_str!("../../../shaders/common/several.wgsl"),
    include_str!("../../../shaders/several_tiles.wgsl"),
);

/// What [`several`] is made of.
const SEVERAL: &str = concat!(
    include_str!("../../../shaders/common/frame.wgsl"),
    include_str!("../../../shaders/common/tiles.wgsl"),
    include_str!("../../../shaders/common/cubic.wgsl"),
    include_str!("../../../shaders/common/several.wgsl"),
    include_str!("../../../shaders/several.wgsl"),
    include_str!("../../../shaders/several_exact.wgsl"),
);

/// What one of several volumes is to the ray-caster.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct PartKind {
    /// Whether its voxels hold labels.
    pub(crate) labels: bool,
    /// Whether there are more of them than a table has entries.
    pub(crate) many_labels: bool,
    /// Whether it is lit.
    pub(crate) lit: bool,
}

/// As [`TILES`], for so many volumes.
pub(crate) fn several_tiles(count: usize) -> String {
    let all: Vec<usize> = (0..count).collect();
    format!("const PARTS: u32 = {count}u;\n{}", each(SEVERAL_TILES, "#each", "#end", &copies(&all)))
}

/// As [`RAYCAST`], for volumes of these kinds: in steps (`several`), or without (`several_exact`).
pub(crate) fn several(kinds: &[PartKind]) -> String {
    let all: Vec<usize> = (0..kinds.len()).collect();
    // The sets of volumes that a stretch of a ray may show: those in between are no faster than all.
    let mut sets: Vec<(String, Vec<usize>)> =
        all.iter().map(|&part| (part.to_string(), vec![part])).collect();
    sets.push(("all".into(), all.clone()));
    let set = |body: &str| {
        let of = |(name, parts): &(String, Vec<usize>)| {
            each(body, "#each", "#end", &copies(parts)).replace('%', name)
        };
        sets.iter().map(of).collect::<String>()
    };
    let text = each(SEVERAL, "#sets", "#end_sets", &set);
    let text = each(&text, "#each", "#end", &copies(&all));
    let shaded = |kind: &PartKind| kind.lit && !kind.labels;
    let flags = kinds.iter().enumerate().flat_map(|(part, kind)| {
        [("LABELS", kind.labels), ("MANY", kind.many_labels), ("LIT", kind.lit), ("SHADED", shaded(kind))]
            .map(|(name, on)| (format!("{name}_{part}"), f64::from(u8::from(on))))
    });
    let flags: Vec<(String, f64)> = flags.collect();
    let constants: Vec<(&str, f64)> = flags.iter().map(|(name, on)| (name.as_str(), *on)).collect();
    let any_shaded = kinds.iter().any(shaded);
    let head = format!("const PARTS: u32 = {}u;\nconst SHADED: bool = {any_shaded};\n", kinds.len());
    head + &cut(&text, &constants)
}

/// A text with what stands between lines `open` and `close` as `made` makes it.
fn each(text: &str, open: &str, close: &str, made: &dyn Fn(&str) -> String) -> String {
    let (mut out, mut body) = (String::new(), None::<String>);
    for line in text.split_inclusive('\n') {
        match (line.trim() == open, line.trim() == close, &mut body) {
            (true, _, None) => body = Some(String::new()),
            (_, true, Some(inside)) => {
                out += &made(inside);
                body = None;
            }
            (_, _, Some(inside)) => inside.push_str(line),
            _ => out += line,
        }
    }
    out
}

/// A copy for each part, with its number, and with the bindings of its voxels and its table.
fn copies(parts: &[usize]) -> impl Fn(&str) -> String {
    let parts = parts.to_vec();
    move |body| {
        let copy = |part: &usize| {
            let numbered = body.replace("$VOXELS", &(1 + part).to_string());
            numbered.replace("$TABLE", &(MOST_VOLUMES + part).to_string()).replace('$', &part.to_string())
        };
        parts.iter().map(copy).collect()
    }
}

/// Luma and chroma of each ray.
pub(crate) const TONE: &str = concat!(
    include_str!("../../../shaders/common/frame.wgsl"),
    include_str!("../../../shaders/common/yuv.wgsl"),
    include_str!("../../../shaders/tone.wgsl"),
);

/// Convert the picture to YUV 4:2:0.
pub(crate) const CONVERT: &str = concat!(
    include_str!("../../../shaders/common/frame.wgsl"),
    include_str!("../../../shaders/common/yuv.wgsl"),
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

    const ALL: [(&str, &str); 6] = [
        ("tiles", TILES),
        ("raycast", RAYCAST),
        ("spread", SPREAD),
        ("tone", TONE),
        ("convert", CONVERT),
        ("depth", DEPTH),
    ];

    /// All kinds that a volume may be of.
    const KINDS: [PartKind; 5] = [
        PartKind { labels: false, many_labels: false, lit: false },
        PartKind { labels: false, many_labels: false, lit: true },
        PartKind { labels: true, many_labels: false, lit: false },
        PartKind { labels: true, many_labels: true, lit: false },
        PartKind { labels: true, many_labels: true, lit: true },
    ];

    #[test]
    fn what_is_for_each_volume_comes_once_for_each() {
        let text = "a\n#each\nb_$ $VOXELS $TABLE\n#end\nc\n";
        assert_eq!(each(text, "#each", "#end", &copies(&[0, 2])), "a\nb_0 1 4\nb_2 3 6\nc\n");
    }

    #[test]
    fn every_shader_of_several_volumes_is_valid_and_knows_of_no_more_than_there_are() {
        for count in 1..=MOST_VOLUMES {
            validate(&format!("tiles of {count}"), &several_tiles(count));
            for first in 0..KINDS.len() {
                // Every kind at every place, beside others.
                let kinds: Vec<PartKind> = (0..count).map(|i| KINDS[(first + i * 3) % KINDS.len()]).collect();
                let text = several(&kinds);
                validate(&format!("{kinds:?}"), &text);
                assert!(
                    !text.contains(&format!("voxels_{count}"))
                        && !text.contains("if (L")
                        && !text.contains("if (M"),
                    "{kinds:?}"
                );
                let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
                assert!(code.clone().all(|line| !line.contains(['$', '#'])), "{kinds:?}");
                for (part, kind) in kinds.iter().enumerate() {
                    // What a volume does not need is not called.
                    let calls = |name: &str| text.matches(&format!("{name}_{part}(")).count() > 1;
                    assert_eq!(calls("light"), kind.lit && !kind.labels, "{kinds:?}, {part}");
                    assert_eq!(calls("light_run"), kind.lit && kind.labels, "{kinds:?}, {part}");
                    assert!(calls("march"), "{kinds:?}, {part}");
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
        for (name, text) in ALL {
            validate(name, text);
        }
    }

    #[test]
    fn no_shader_has_more_storage_textures_than_a_device_is_asked_for() {
        let several = [several_tiles(MOST_VOLUMES), several(&KINDS[..MOST_VOLUMES])];
        let texts = ALL.iter().map(|(_, text)| *text).chain(several.iter().map(String::as_str));
        let most = texts.map(|text| text.matches(": texture_storage_").count()).max();
        assert_eq!(most, Some(crate::gpu::STORAGE_TEXTURES as usize));
    }

    #[test]
    fn every_shader_file_is_used() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shaders");
        let all = ALL.map(|(_, text)| text).concat() + SEVERAL + SEVERAL_TILES;
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
