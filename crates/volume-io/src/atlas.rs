//! The HoloM3D slice atlas: slices of a volume as tiles of one PNG.
//!
//! Tile i, counted row by row from the upper left, is slice i. Without a JSON beside it, the atlas is 4096 × 4096 RGBA
//! with 16 × 16 tiles of 256 × 256, and R is PET, G is CT, B is a segmentation, A is free. The fields of the JSON are
//! documented in `docs/volume-formats.md`.

use crate::load::{checked_axis, finish};
use crate::samples::zeroed;
use crate::sidecar::{self, KindJson, Meaning, Rows};
use crate::source::{Part, Source};
use crate::stream::MOST_EXPANSION;
use crate::{Format, LoadError, LoadOptions, Loaded};
use png::{BitDepth, ColorType, DecodingError};
use serde::Deserialize;
use spatial::DVec3;
use volume::{Channel, ChannelKind, Grid, Voxels};

/// How a PNG begins.
pub(crate) const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
/// Most bytes that the PNG decoder may take beside the voxels: rows and side information, never the picture.
const DECODER_BYTES: usize = 16 << 20;
/// Rows between two calls of the progress callback.
const ROWS_A_CALL: usize = 256;

/// The JSON beside an atlas; what it leaves out is as without one.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct AtlasJson {
    columns: Option<i64>,
    rows: Option<i64>,
    tile_px: Option<[i64; 2]>,
    slices: Option<i64>,
    spacing_mm: Option<[f64; 3]>,
    volume_from_index: Option<Rows>,
    channels: Option<Vec<AtlasChannel>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct AtlasChannel {
    component: Component,
    name: String,
    kind: Option<KindJson>,
    slope: Option<f64>,
    intercept: Option<f64>,
}

/// A component of a pixel. A grey PNG has R, and A if it has an alpha channel.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
enum Component {
    R,
    G,
    B,
    A,
}

/// How slices are laid out in the picture.
#[derive(Clone, Copy, Debug)]
struct Tiling {
    columns: usize,
    rows: usize,
    /// Width and height of a tile in pixels.
    tile_px: [usize; 2],
    /// Slices in use, from the first tile on.
    slices: usize,
}

/// Loads an atlas, with the JSON of the same name if there is one.
pub(crate) fn load(source: &Source<'_>, part: Part<'_>, options: &LoadOptions) -> Result<Loaded, LoadError> {
    let Part { name: file, length, input } = part;
    let file = file.as_str();
    let mut notes = Vec::new();
    let (json, said_by) = match source.open_json_beside()? {
        Some(mut part) => (sidecar::read_json(&mut part)?, part.name),
        None => (AtlasJson::default(), file.to_owned()),
    };
    let tiling = Tiling::checked(&said_by, &json)?;

    let mut decoder = png::Decoder::new_with_limits(input, png::Limits { bytes: DECODER_BYTES });
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let damaged = |e: DecodingError| damaged(file, &e);
    let info = decoder.read_header_info().map_err(damaged)?;
    tiling.check_picture(file, [info.width, info.height])?;
    let (components, sample_bytes) = pixels(file, info)?;
    let wanted = wanted(&said_by, &json, components)?;

    // Axes of 15 bits, 4 channels, 2 bytes: no product overflows 64 bits.
    let voxels = (tiling.slice_px() * tiling.slices) as u64;
    options.check_size(file, u128::from(voxels * wanted.len() as u64 * sample_bytes))?;
    let tiles = (tiling.columns * tiling.rows) as u64;
    let picture_bytes = tiling.slice_px() as u64 * tiles * components.len() as u64 * sample_bytes;
    if length.saturating_mul(MOST_EXPANSION) < picture_bytes {
        return Err(LoadError::Truncated {
            file: file.to_owned(),
            what: "PNG data",
            expected: picture_bytes.div_ceil(MOST_EXPANSION),
            found: length,
        });
    }

    let mut reader = decoder.read_info().map_err(damaged)?;
    let mut picture = Picture { file, options, reader: &mut reader, tiling, components: components.len() };
    let collapse = json.channels.is_none();
    let mut channels = if sample_bytes == 1 {
        picture.planes::<u8>(&wanted, collapse)?.into_channels(wanted, |v| Voxels::U8(v.into()))
    } else {
        picture.planes::<u16>(&wanted, collapse)?.into_channels(wanted, |v| Voxels::U16(v.into()))
    };
    if collapse {
        drop_what_says_nothing(&mut channels, components, &mut notes);
    }
    let slices = if json.slices.is_some() {
        tiling.slices
    } else {
        trim(&mut channels, tiling.slice_px(), tiling.slices, &mut notes)
    };
    if let ([only], Some(kind)) = (channels.as_mut_slice(), options.kind) {
        only.kind = kind;
    }

    let dims = [tiling.tile_px[0] as u32, tiling.tile_px[1] as u32, slices as u32];
    let grid = match sidecar::grid(&said_by, dims, json.spacing_mm, json.volume_from_index)? {
        Some(grid) => grid,
        None => {
            notes.push(
                "spacing is not in the file: voxels of 1 mm are assumed, columns to the patient's left, rows to \
                 posterior, slices to superior"
                    .to_owned(),
            );
            Grid::axis_aligned(dims, DVec3::ONE).map_err(|source| LoadError::Grid {
                file: file.to_owned(),
                field: "size",
                source,
            })?
        }
    };
    finish(file, Format::Atlas, grid, channels, notes)
}

impl Tiling {
    fn checked(file: &str, json: &AtlasJson) -> Result<Self, LoadError> {
        let axis = |field, found| checked_axis(file, field, found).map(|n| n as usize);
        let [width, height] = json.tile_px.unwrap_or([256, 256]);
        let (columns, rows) =
            (axis("columns", json.columns.unwrap_or(16))?, axis("rows", json.rows.unwrap_or(16))?);
        let tile_px = [axis("tile_px[0]", width)?, axis("tile_px[1]", height)?];
        let tiles = columns * rows;
        let slices = match json.slices {
            Some(slices) => axis("slices", slices)?,
            None => axis("columns times rows", tiles as i64)?,
        };
        if slices > tiles {
            return Err(LoadError::field(file, "slices", format!("at most the {tiles} tiles"), &slices));
        }
        Ok(Self { columns, rows, tile_px, slices })
    }

    /// Pixels of a slice.
    fn slice_px(&self) -> usize {
        self.tile_px[0] * self.tile_px[1]
    }

    fn check_picture(&self, file: &str, found_px: [u32; 2]) -> Result<(), LoadError> {
        let Self { columns, rows, tile_px: [width, height], .. } = *self;
        let [expected_width, expected_height] = [columns * width, rows * height];
        if found_px.map(|n| n as usize) == [expected_width, expected_height] {
            return Ok(());
        }
        let expected = format!(
            "{expected_width} × {expected_height} px ({columns} × {rows} tiles of {width} × {height})"
        );
        let found = format!("{} × {} px", found_px[0], found_px[1]);
        Err(LoadError::field(file, "size of the atlas", expected, &found))
    }
}

/// The components of a pixel and the bytes of each, if the picture is of a kind that is read.
fn pixels(file: &str, info: &png::Info<'_>) -> Result<(&'static [Component], u64), LoadError> {
    if info.interlaced {
        return Err(LoadError::field(file, "interlacing", "none", "Adam7"));
    }
    let components: &[Component] = match info.color_type {
        ColorType::Grayscale => &[Component::R],
        ColorType::GrayscaleAlpha => &[Component::R, Component::A],
        ColorType::Rgb => &[Component::R, Component::G, Component::B],
        ColorType::Rgba => &[Component::R, Component::G, Component::B, Component::A],
        ColorType::Indexed => {
            return Err(LoadError::field(file, "colour type", "grey, RGB or RGBA", "a palette"));
        }
    };
    match info.bit_depth {
        BitDepth::Eight => Ok((components, 1)),
        BitDepth::Sixteen => Ok((components, 2)),
        fewer => {
            let found = format!("{} bits", fewer as u8);
            Err(LoadError::field(file, "bit depth", "8 or 16 bits", &found))
        }
    }
}

/// Which component becomes which channel: what the JSON says, or what HoloM3D means by them.
fn wanted(
    file: &str,
    json: &AtlasJson,
    components: &[Component],
) -> Result<Vec<(usize, Meaning)>, LoadError> {
    let place = |component: Component| components.iter().position(|c| *c == component);
    let Some(channels) = &json.channels else {
        return Ok(components
            .iter()
            .map(|&component| match component {
                Component::R if components.len() < 3 => Meaning::plain("image", ChannelKind::Intensity),
                Component::R => Meaning::plain("pet", ChannelKind::Intensity),
                Component::G => Meaning::plain("ct", ChannelKind::Intensity),
                Component::B => Meaning::plain("labels", ChannelKind::Label),
                Component::A => Meaning::plain("spare", ChannelKind::Intensity),
            })
            .enumerate()
            .collect());
    };
    if !(1..=components.len()).contains(&channels.len()) {
        let expected = format!("1 to {}, as many as the PNG has", components.len());
        return Err(LoadError::field(file, "channels", expected, &channels.len()));
    }
    channels
        .iter()
        .map(|c| {
            let place = place(c.component).ok_or_else(|| {
                let expected = format!("one of {components:?}, which the PNG has");
                LoadError::field(file, "component", expected, &format!("{:?}", c.component))
            })?;
            Ok((place, Meaning::checked(file, Some(c.name.clone()), c.kind, c.slope, c.intercept)?))
        })
        .collect()
}

/// A PNG that is read row by row: its pixels are never in memory as a whole.
struct Picture<'a, R: std::io::BufRead + std::io::Seek> {
    file: &'a str,
    options: &'a LoadOptions,
    reader: &'a mut png::Reader<R>,
    tiling: Tiling,
    /// Components of a pixel.
    components: usize,
}

/// The voxels of some components; of one alone, if all components turned out equal.
struct Planes<T>(Vec<Vec<T>>);

impl<T> Planes<T> {
    fn into_channels(self, meanings: Vec<(usize, Meaning)>, held: fn(Vec<T>) -> Voxels) -> Vec<Channel> {
        if self.0.len() < meanings.len() {
            let image = Meaning::plain("image", ChannelKind::Intensity);
            return self.0.into_iter().map(|plane| image.clone().with(held(plane))).collect();
        }
        self.0.into_iter().zip(meanings).map(|(plane, (_, meaning))| meaning.with(held(plane))).collect()
    }
}

impl<R: std::io::BufRead + std::io::Seek> Picture<'_, R> {
    /// Reads the rows and deals their tiles out to slices. With `collapse`, components that are equal in every pixel
    /// give a single plane, and the others are not even allocated.
    fn planes<T: PngSample>(
        &mut self,
        wanted: &[(usize, Meaning)],
        collapse: bool,
    ) -> Result<Planes<T>, LoadError> {
        let Tiling { columns, rows, tile_px: [width, height], slices } = self.tiling;
        let count = self.tiling.slice_px() * slices;
        let pixel_bytes = self.components * size_of::<T>();
        let mut all_equal = collapse && wanted.len() > 1;
        let first = if all_equal { 1 } else { wanted.len() };
        let mut planes: Vec<Vec<T>> =
            (0..first).map(|_| zeroed(self.file, count)).collect::<Result<_, _>>()?;

        for y in 0..rows * height {
            let row = self.reader.next_row().map_err(|e| damaged(self.file, &e))?.ok_or_else(|| {
                LoadError::Truncated {
                    file: self.file.to_owned(),
                    what: "PNG rows",
                    expected: (rows * height) as u64,
                    found: y as u64,
                }
            })?;
            let row = row.data();
            let (tile_row, y_in_tile) = (y / height, y % height);
            if all_equal && !row.chunks_exact(pixel_bytes).all(T::components_equal) {
                all_equal = false;
                for _ in 1..wanted.len() {
                    let mut plane = zeroed(self.file, count)?;
                    // What came before this row was equal in all components.
                    let so_far = count.min((tile_row + 1) * columns * width * height);
                    plane[..so_far].copy_from_slice(&planes[0][..so_far]);
                    planes.push(plane);
                }
            }
            for (column, pixels) in row.chunks_exact(width * pixel_bytes).enumerate() {
                let slice = tile_row * columns + column;
                if slice >= slices {
                    break;
                }
                if pixels.iter().all(|b| *b == 0) {
                    // Zero already: tiles that are not in use take no memory.
                    continue;
                }
                let start = (slice * height + y_in_tile) * width;
                for (plane, (component, _)) in planes.iter_mut().zip(wanted) {
                    let at = component * size_of::<T>();
                    for (voxel, pixel) in
                        plane[start..start + width].iter_mut().zip(pixels.chunks_exact(pixel_bytes))
                    {
                        *voxel = T::from_png(&pixel[at..]);
                    }
                }
            }
            if y % ROWS_A_CALL == ROWS_A_CALL - 1 || y + 1 == rows * height {
                self.options.progressed((y + 1) as f32 / (rows * height) as f32);
            }
        }
        // The checksums stand at the end.
        self.reader.finish().map_err(|e| damaged(self.file, &e))?;
        Ok(Planes(planes))
    }
}

/// A component of a PNG's pixel: 8 bits, or 16 with the high byte first.
trait PngSample: bytemuck::Pod {
    fn from_png(bytes: &[u8]) -> Self;
    /// Whether the components of one pixel are equal.
    fn components_equal(pixel: &[u8]) -> bool {
        let mut components = pixel.chunks_exact(size_of::<Self>());
        let first = components.next();
        components.all(|c| Some(c) == first)
    }
}

impl PngSample for u8 {
    fn from_png(bytes: &[u8]) -> Self {
        bytes[0]
    }
}

impl PngSample for u16 {
    fn from_png(bytes: &[u8]) -> Self {
        Self::from_be_bytes([bytes[0], bytes[1]])
    }
}

/// Says that equal components became one channel, and drops an alpha channel that is constant.
fn drop_what_says_nothing(channels: &mut Vec<Channel>, components: &[Component], notes: &mut Vec<String>) {
    if channels.len() < components.len() {
        notes.push(format!("the {} components of every pixel are equal: one channel", components.len()));
        return;
    }
    if let [.., _, alpha] = channels.as_slice()
        && components.last() == Some(&Component::A)
        && let Some(value) = constant(&alpha.voxels)
    {
        notes.push(format!("the alpha component is {value} everywhere and is left out"));
        channels.pop();
    }
}

/// The value of all samples, if they have one.
fn constant(voxels: &Voxels) -> Option<f64> {
    let first = voxels.stored(0);
    let same = match voxels {
        Voxels::U8(v) => v.iter().all(|s| *s == v[0]),
        Voxels::U16(v) => v.iter().all(|s| *s == v[0]),
        Voxels::I16(_) | Voxels::F32(_) | Voxels::F64(_) => false,
    };
    same.then_some(first)
}

/// Leaves out the empty slices at the end and gives their memory back; returns how many slices stay, at least one.
fn trim(channels: &mut [Channel], slice_px: usize, slices: usize, notes: &mut Vec<String>) -> usize {
    fn used<T: Copy + Default + PartialEq>(samples: &[T]) -> usize {
        samples.iter().rposition(|s| *s != T::default()).map_or(0, |last| last + 1)
    }
    let last_used = channels.iter().map(|c| match &c.voxels {
        Voxels::U8(v) => used(v),
        Voxels::U16(v) => used(v),
        Voxels::I16(v) => used(v),
        Voxels::F32(v) => used(v),
        Voxels::F64(v) => used(v),
    });
    let in_use = last_used.max().unwrap_or_default().div_ceil(slice_px).max(1);
    if in_use == slices {
        return slices;
    }
    for channel in channels {
        let length = in_use * slice_px;
        match &mut channel.voxels {
            Voxels::U8(v) => v.truncate(length),
            Voxels::U16(v) => v.truncate(length),
            Voxels::I16(v) => v.truncate(length),
            Voxels::F32(v) => v.truncate(length),
            Voxels::F64(v) => v.truncate(length),
        }
    }
    notes.push(format!("{} empty slices after the first {in_use} are left out", slices - in_use));
    in_use
}

fn damaged(file: &str, e: &DecodingError) -> LoadError {
    LoadError::Damaged { file: file.to_owned(), what: "PNG", reason: e.to_string() }
}
