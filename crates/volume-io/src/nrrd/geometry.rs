//! From the fields about axes and space to a grid in patient millimetres.

use super::header::Header;
use crate::LoadError;
use crate::text::{integers, numbers, short};
use spatial::{DAffine3, DMat3, DVec3};
use volume::Grid;

/// The axes of a file, fastest first.
pub(super) struct Axes {
    pub(super) sizes: Vec<i64>,
    /// Which three of them are in space.
    pub(super) spatial: [usize; 3],
    /// Their steps in the file's space, if it has one.
    directions: Option<[DVec3; 3]>,
}

impl Axes {
    /// Volumes that follow each other: the product of the axes that are slower than space.
    pub(super) fn steps(&self, file: &str) -> Result<u64, LoadError> {
        let [.., last] = self.spatial;
        let mut steps = 1u64;
        for (axis, &size) in self.sizes.iter().enumerate().filter(|(a, _)| !self.spatial.contains(a)) {
            if axis < last && size != 1 {
                let expected = "one number a voxel (vectors, colours and lists of segments are not volumes)";
                return Err(LoadError::field(file, "sizes", expected, &format!("{size} on axis {axis}")));
            }
            steps = u64::try_from(size)
                .ok()
                .filter(|&s| s > 0)
                .and_then(|s| steps.checked_mul(s))
                .ok_or_else(|| LoadError::field(file, "sizes", "1 or more on each axis", &size))?;
        }
        Ok(steps)
    }

    /// Seconds from one volume to the next, if one axis is slower than space and the file says how far its samples are
    /// apart, in a unit of time.
    pub(super) fn step_secs(&self, header: &Header) -> Option<f64> {
        let [.., last] = self.spatial;
        if self.sizes.len() != last + 2 {
            return None;
        }
        let spacing: f64 = header.get(&["spacings"])?.split_whitespace().nth(last + 1)?.parse().ok()?;
        // Each axis has its unit in quotes.
        let unit = header.get(&["units"])?.split('"').nth(2 * (last + 1) + 1)?;
        let secs = match unit {
            "s" | "sec" | "secs" | "second" | "seconds" => 1.0,
            "ms" | "msec" | "milliseconds" => 1.0e-3,
            "us" | "usec" | "microseconds" => 1.0e-6,
            _ => return None,
        };
        Some(spacing * secs).filter(|secs| secs.is_finite() && *secs > 0.0)
    }
}

/// Finds the axes that are in space: those with a direction, else those of such a kind, else the first three.
pub(super) fn axes(file: &str, header: &Header) -> Result<Axes, LoadError> {
    let dimension = header.dimension()?;
    let sizes = integers(file, "sizes", header.required("sizes")?, dimension)?;
    let kinds: Option<Vec<&str>> = header.get(&["kinds"]).map(|kinds| kinds.split_whitespace().collect());
    if let Some(kinds) = kinds.as_ref().filter(|kinds| kinds.len() != dimension) {
        return Err(LoadError::field(file, "kinds", format!("{dimension} kinds"), &kinds.len()));
    }
    let directions = match header.get(&["space directions"]) {
        None => None,
        Some(text) => Some(vectors(file, "space directions", text, dimension, space_axes(file, header)?)?),
    };
    let spatial: Vec<usize> = match (&directions, &kinds) {
        (Some(directions), _) => (0..dimension).filter(|&a| directions[a].is_some()).collect(),
        (None, Some(kinds)) => {
            let in_space = |kind: &str| matches!(kind, "space" | "domain" | "none" | "???");
            (0..dimension).filter(|&a| in_space(kinds[a])).collect()
        }
        (None, None) => (0..dimension).take(3).collect(),
    };
    let count = spatial.len();
    let spatial: [usize; 3] = spatial.try_into().map_err(|_| {
        let field = if directions.is_some() { "space directions" } else { "dimension" };
        LoadError::field(file, field, "three axes in space", &count)
    })?;
    let directions = directions.and_then(|d| Some([d[spatial[0]]?, d[spatial[1]]?, d[spatial[2]]?]));
    Ok(Axes { sizes, spatial, directions })
}

/// The grid of the three axes in space.
pub(super) fn grid(
    file: &str,
    header: &Header,
    axes: &Axes,
    dims: [u32; 3],
    notes: &mut Vec<String>,
) -> Result<Grid, LoadError> {
    let dimension = axes.sizes.len();
    let refused = |field, source| LoadError::Grid { file: file.to_owned(), field, source };
    let Some([x, y, z]) = axes.directions else {
        // Version 1 to 3: spacing and the range of each axis, in no named space.
        let per_axis = |field: &'static str, other: &'static str| match header.get(&[field, other]) {
            None => Ok(None),
            Some(text) => numbers(file, field, text, dimension)
                .map(|n| Some(DVec3::from_array(axes.spatial.map(|a| n[a])))),
        };
        let spacing = per_axis("spacings", "spacings")?.map(|s| s.map(f64::abs));
        let origin = per_axis("axis mins", "axismins")?.filter(|o| o.is_finite());
        notes.push(
            "orientation is not in the file (no space directions): axes are taken to point to the patient's left, \
             posterior, superior"
                .to_owned(),
        );
        let spacing = spacing.filter(|s| !s.is_nan()).unwrap_or_else(|| {
            notes.push("spacing is not in the file: 1 mm is used".to_owned());
            DVec3::ONE
        });
        // The range of an axis begins at the border of the first voxel, unless its samples lie on nodes.
        let nodes = header.get(&["centers", "centerings"]).is_some_and(|c| c.contains("node"));
        let first = origin.map_or(DVec3::ZERO, |o| if nodes { o } else { o + spacing / 2.0 });
        let transform = DAffine3 { matrix3: DMat3::from_diagonal(spacing), translation: first };
        return Grid::new(dims, transform).map_err(|e| refused("spacings", e));
    };
    let origin = match header.get(&["space origin"]) {
        Some(text) => vectors(file, "space origin", text, 1, space_axes(file, header)?)?[0],
        None => None,
    };
    let origin = origin.unwrap_or_else(|| {
        notes.push("space origin is not in the file: the first voxel is taken to be at 0, 0, 0".to_owned());
        DVec3::ZERO
    });
    let lps_from_space = DMat3::from_diagonal(lps_signs(file, header, notes)? * mm_per_unit(header, notes));
    let matrix3 = lps_from_space * DMat3::from_cols(x, y, z);
    let transform = DAffine3 { matrix3, translation: lps_from_space * origin };
    Grid::new(dims, transform).map_err(|e| refused("space directions", e))
}

/// Numbers of a vector: three, and a fourth of time if the space has one.
fn space_axes(file: &str, header: &Header) -> Result<usize, LoadError> {
    if let Some(text) = header.get(&["space dimension"]) {
        return match integers(file, "space dimension", text, 1)?[0] {
            3 => Ok(3),
            other => Err(LoadError::field(file, "space dimension", "3", &other)),
        };
    }
    let space = header.required("space")?.to_ascii_lowercase();
    Ok(if space.ends_with("-time") || matches!(space.as_str(), "rast" | "last" | "lpst") { 4 } else { 3 })
}

/// Signs that turn the file's space to the left, posterior and superior.
fn lps_signs(file: &str, header: &Header, notes: &mut Vec<String>) -> Result<DVec3, LoadError> {
    let Some(space) = header.get(&["space"]) else {
        notes.push("the file's space has no name: it is taken to be left, posterior, superior".to_owned());
        return Ok(DVec3::ONE);
    };
    Ok(match space.to_ascii_lowercase().as_str() {
        "left-posterior-superior" | "lps" | "left-posterior-superior-time" | "lpst" => DVec3::ONE,
        "right-anterior-superior" | "ras" | "right-anterior-superior-time" | "rast" => {
            DVec3::new(-1.0, -1.0, 1.0)
        }
        "left-anterior-superior" | "las" | "left-anterior-superior-time" | "last" => {
            DVec3::new(1.0, -1.0, 1.0)
        }
        "scanner-xyz"
        | "scanner-xyz-time"
        | "3d-right-handed"
        | "3d-right-handed-time"
        | "3d-left-handed"
        | "3d-left-handed-time" => {
            notes.push(format!(
                "the file's space is {space}, not the patient's: it is taken to be left, posterior, superior"
            ));
            DVec3::ONE
        }
        _ => {
            let expected = "left-posterior-superior, right-anterior-superior or another of the definition";
            return Err(LoadError::field(file, "space", expected, &short(space)));
        }
    })
}

/// Millimetres of the unit that the file's space is in.
fn mm_per_unit(header: &Header, notes: &mut Vec<String>) -> f64 {
    let Some(units) = header.get(&["space units"]) else { return 1.0 };
    let first = units.split('"').nth(1).unwrap_or_default().trim();
    let mm = match first {
        "mm" | "" => return 1.0,
        "m" => 1.0e3,
        "cm" => 10.0,
        "um" | "µm" | "micron" | "microns" => 1.0e-3,
        other => {
            notes.push(format!("lengths are in {} in the file: taken as millimetres", short(other)));
            return 1.0;
        }
    };
    notes.push(format!("lengths are in {first} in the file"));
    mm
}

/// `(x,y,z) (x,y,z) none`: a vector for each axis. A vector of NaN, or of time alone, is none.
fn vectors(
    file: &str,
    field: &'static str,
    text: &str,
    count: usize,
    length: usize,
) -> Result<Vec<Option<DVec3>>, LoadError> {
    let wrong = || {
        LoadError::field(file, field, format!("{count} vectors of {length} numbers, or none"), &short(text))
    };
    let mut vectors = Vec::new();
    let mut rest = text.trim_start();
    while !rest.is_empty() {
        if vectors.len() == count {
            return Err(wrong());
        }
        if let Some(after) = rest.strip_prefix("none") {
            vectors.push(None);
            rest = after.trim_start();
            continue;
        }
        let (inside, after) = rest.strip_prefix('(').and_then(|r| r.split_once(')')).ok_or_else(wrong)?;
        let numbers: Result<Vec<f64>, _> = inside.split(',').map(|n| n.trim().parse::<f64>()).collect();
        let numbers = numbers.ok().filter(|n| n.len() == length).ok_or_else(wrong)?;
        let vector = DVec3::new(numbers[0], numbers[1], numbers[2]);
        let time = numbers.get(3).copied().unwrap_or(0.0);
        if time != 0.0 && vector != DVec3::ZERO {
            return Err(LoadError::field(file, field, "axes of space or of time, not of both", &short(text)));
        }
        vectors.push((time == 0.0 && !numbers.iter().all(|n| n.is_nan())).then_some(vector));
        rest = after.trim_start();
    }
    if vectors.len() == count { Ok(vectors) } else { Err(wrong()) }
}
