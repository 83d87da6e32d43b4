//! DICOM: a file, or the files of a folder, become the volume of one series.
//!
//! Sources: DICOM PS3.3 (what elements mean), PS3.5 (how they are written). dicom-rs reads the data set; what is read
//! here, and why, says `docs/decisions/0017-dicom.md`. Nothing that names a patient leaves this module unless
//! [`LoadOptions::identity`] asks for it.

mod codec;
mod files;
mod jpeg_ls;
mod object;
mod pixels;
mod stack;
mod suv;
mod syntax;
mod tags;

use crate::load::{checked_axis, checked_scaling, finish};
use crate::samples::{drawn_in_single, zeroed, zeroed_buffer};
use crate::source::Source;
use crate::text::short;
use crate::{Format, LoadError, LoadOptions, Loaded};
use files::Files;
use object::Object;
use pixels::{Frame, Held, Layout};
use rayon::prelude::*;
use stack::{Names, Slice, Stack};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicUsize, Ordering};
use volume::{Buffer, Channel, ChannelKind, Voxels};

pub(crate) use object::is_file;

/// Most frames of one file.
const MOST_FRAMES: f64 = 1_048_576.0;

/// A series that was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SeriesFound {
    /// Its number in the study, if it has one.
    pub number: Option<String>,
    /// Its identifier (Series Instance UID).
    pub uid: String,
    /// `CT`, `MR`, `PT`, …
    pub modality: String,
    /// Files with pixels.
    pub files: usize,
    /// Frames in them.
    pub images: usize,
}

/// Loads the series of a file or folder.
pub(crate) fn load(source: &Source<'_>, options: &LoadOptions) -> Result<Loaded, LoadError> {
    let path = source.name();
    let files = Files::of(source)?;
    let read: Vec<Option<Object>> =
        (0..files.len()).into_par_iter().map(|file| Object::read(&files, file)).collect::<Result<_, _>>()?;
    let all = read.len();
    let objects: Vec<Object> = read.into_iter().flatten().collect();
    if objects.is_empty() {
        let found = format!("a folder of {all} files, none of them DICOM");
        return Err(LoadError::UnknownFormat { file: path, found });
    }
    let mut notes = Vec::new();
    if objects.len() < all {
        notes.push(format!("{} files that are not DICOM were left out", all - objects.len()));
    }
    let dicom = objects.len();
    let images: Vec<Object> = objects.into_iter().filter(|o| o.pixels.is_some()).collect();
    if images.is_empty() {
        return Err(LoadError::field(
            &path,
            "pixel data",
            "images",
            &format!("{dicom} DICOM objects without"),
        ));
    }
    if images.len() < dicom {
        notes.push(format!("{} DICOM objects without pixels were left out", dicom - images.len()));
    }
    let patients: BTreeSet<_> = images.iter().map(who).collect();
    if patients.len() > 1 {
        if !options.force {
            return Err(LoadError::SeveralPatients { file: path, found: patients.len() });
        }
        notes
            .push(format!("these are images of {} patients, loaded because that was forced", patients.len()));
    }
    drop(patients);

    let (images, series) = chosen(&path, images, options, &mut notes)?;
    let mut loaded = load_series(&path, &files, &images, options, notes)?;
    loaded.report.series = series;
    Ok(loaded)
}

/// What tells one patient from another: the identifier, else the name.
fn who(object: &Object) -> &[u8] {
    let [id, name] = object.patient();
    let id = id.trim_ascii();
    if id.is_empty() { name.trim_ascii() } else { id }
}

/// The images of the series that was asked for, else of the one with the most, and what there is.
fn chosen(
    path: &str,
    images: Vec<Object>,
    options: &LoadOptions,
    notes: &mut Vec<String>,
) -> Result<(Vec<Object>, Vec<SeriesFound>), LoadError> {
    let mut by_uid: BTreeMap<String, Vec<Object>> = BTreeMap::new();
    for image in images {
        by_uid.entry(image.top.text(tags::SERIES_INSTANCE_UID).unwrap_or_default()).or_default().push(image);
    }
    let mut series: Vec<SeriesFound> = by_uid
        .iter()
        .map(|(uid, images)| SeriesFound {
            number: images[0]
                .top
                .text(tags::SERIES_NUMBER)
                .filter(|n| n.len() <= 16 && n.bytes().all(|b| b.is_ascii_graphic())),
            uid: uid.clone(),
            modality: modality(&images[0]),
            files: images.len(),
            images: images.iter().filter_map(|image| frames(image).ok()).sum(),
        })
        .collect();
    let number = |s: &SeriesFound| s.number.as_ref().and_then(|n| n.parse::<i64>().ok()).unwrap_or(i64::MAX);
    series.sort_by_key(|s| (number(s), s.uid.clone()));
    let one = match &options.series {
        Some(asked) => {
            let fits = |s: &&SeriesFound| s.uid == *asked || s.number.as_ref() == Some(asked);
            let mut fitting = series.iter().filter(fits);
            match (fitting.next(), fitting.next()) {
                (Some(one), None) => one,
                (found, _) => {
                    let found = if found.is_some() { "several of that number" } else { "none of that" };
                    let there: Vec<String> = series.iter().map(ToString::to_string).collect();
                    let expected = format!("a number or UID of: {}", there.join("; "));
                    let found = format!("{} ({found})", short(asked));
                    return Err(LoadError::field(path, "series", expected, &found));
                }
            }
        }
        None => {
            let most = series.iter().map(|s| s.images).max();
            // Of several as large, the first.
            series.iter().find(|s| Some(s.images) == most).unwrap_or(&series[0])
        }
    };
    if options.series.is_none() && series.len() > 1 {
        let others: Vec<String> = series.iter().map(ToString::to_string).collect();
        notes.push(format!(
            "{} series are here, and the largest is loaded, {one}; ask for one by its number or UID: {}",
            series.len(),
            others.join("; ")
        ));
    }
    let images = by_uid.remove(&one.uid).unwrap_or_default();
    Ok((images, series))
}

impl std::fmt::Display for SeriesFound {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let number = self.number.as_deref().unwrap_or("without number");
        write!(
            f,
            "{number} ({}, {} images, {})",
            self.modality,
            self.images,
            short(&self.uid).trim_matches('"')
        )
    }
}

/// The modality's code, if it is one.
fn modality(object: &Object) -> String {
    let text = object.top.text(tags::MODALITY).unwrap_or_default();
    let is_code =
        (1..=16).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
    if is_code { text } else { "OT".to_owned() }
}

/// Number of frames of a file.
fn frames(object: &Object) -> Result<usize, String> {
    match object.top.text(tags::FRAMES) {
        None => Ok(1),
        Some(text) => {
            let number =
                text.parse().ok().filter(|n: &f64| (1.0..=MOST_FRAMES).contains(n) && n.fract() == 0.0);
            number.map(|n| n as usize).ok_or(text)
        }
    }
}

/// An image with what its samples are.
struct Image<'a> {
    object: &'a Object,
    layout: Layout,
    frames: usize,
}

fn load_series(
    path: &str,
    files: &Files<'_>,
    objects: &[Object],
    options: &LoadOptions,
    mut notes: Vec<String>,
) -> Result<Loaded, LoadError> {
    let mut images = Vec::with_capacity(objects.len());
    let mut slices = Vec::new();
    let mut refused = Vec::new();
    for object in objects {
        let file = files.path(object.file);
        // Among slices may be a picture of the screen, in colours: it is left out, unless there is nothing else.
        let layout = match Layout::of(&file, object) {
            Ok(layout) => layout,
            Err(error) => {
                refused.push((files.name(object.file), error));
                continue;
            }
        };
        let index = images.len();
        checked_axis(&file, "Columns", layout.columns as i64)?;
        checked_axis(&file, "Rows", layout.rows as i64)?;
        let frames = frames(object).map_err(|found| {
            LoadError::field(&file, "Number of Frames", format!("1 to {MOST_FRAMES}"), &short(&found))
        })?;
        layout.check_data(&file, object, frames)?;
        for frame in 0..frames {
            slices.push(Slice::of(&file, object, index, frame, [layout.rows, layout.columns])?);
        }
        images.push(Image { object, layout, frames });
    }
    match refused.into_iter().next() {
        Some((_, error)) if images.is_empty() => return Err(error),
        Some((name, error)) => {
            let left_out = objects.len() - images.len();
            notes.push(format!(
                "{left_out} images are no slices and were left out, such as {name}: {}",
                error.what()
            ));
        }
        None => {}
    }
    let objects: Vec<&Object> = images.iter().map(|image| image.object).collect();
    let objects = objects.as_slice();
    let names = Names { files, objects };
    let stack = Stack::of(path, options, slices, &names, &mut notes)?;
    note_what_was_assumed(objects[stack.slices[0].object], stack.slices[0].frame, &mut notes);
    if images[stack.slices[0].object].layout.low_is_bright {
        notes.push(
            "low values are meant to be shown bright (MONOCHROME1); values are kept as they are".to_owned(),
        );
    }

    let first = &images[stack.slices[0].object];
    let modality = modality(first.object);
    let (name, suv) = meaning(&modality, first.object, &mut notes);
    let mut scales = Vec::with_capacity(stack.slices.len());
    for slice in &stack.slices {
        let object = images[slice.object].object;
        let number = |tag| object.of_frame(slice.frame, tag).and_then(|n| n.first().copied());
        let file = files.path(object.file);
        let slope =
            number(tags::RESCALE_SLOPE).or_else(|| number(tags::DOSE_GRID_SCALING)).unwrap_or(1.0) * suv;
        let intercept = number(tags::RESCALE_INTERCEPT).unwrap_or(0.0) * suv;
        let (slope, intercept) =
            checked_scaling(&file, ["Rescale Slope", "Rescale Intercept"], slope, intercept)?;
        scales.push([slope, intercept]);
    }

    let held = HeldAs::of(&images, &stack, &scales);
    options.check_size(path, stack.grid.voxel_count() as u128 * held.bytes())?;
    let series = Reading { path, files, images: &images, stack: &stack, scales: &scales, options };
    let (voxels, rounding) = match held {
        HeldAs::U8 => series.read().map(|(v, r)| (Voxels::U8(v), r)),
        HeldAs::I16 => series.read().map(|(v, r)| (Voxels::I16(v), r)),
        HeldAs::U16 => series.read().map(|(v, r)| (Voxels::U16(v), r)),
        HeldAs::F64 => series.read().map(|(v, r)| (Voxels::F64(v), r)),
    }?;
    let (slope, intercept) = if held == HeldAs::F64 {
        notes.push("slices differ in slope, intercept or type, or have 32 bits".to_owned());
        notes.extend(drawn_in_single(&voxels, rounding));
        (1.0, 0.0)
    } else {
        (scales[0][0], scales[0][1])
    };
    let kind = options.kind.unwrap_or(ChannelKind::Intensity);
    let channel = Channel { name: name.to_owned(), kind, voxels, slope, intercept };
    let window = window(first.object, stack.slices[0].frame, suv);
    let mut loaded = finish(path, Format::Dicom, stack.grid, vec![channel], notes)?;
    loaded.report.modality = Some(modality);
    loaded.report.window = window;
    loaded.report.sequence = stack.sequence;
    if options.identity {
        loaded.report.identity = identity(first.object);
    }
    Ok(loaded)
}

/// What geometry the file does not have.
fn note_what_was_assumed(object: &Object, frame: usize, notes: &mut Vec<String>) {
    if object.of_frame(frame, tags::IMAGE_ORIENTATION).is_none() {
        notes.push(
            "orientation is not in the file: rows are taken to run to the patient's left, columns to posterior".to_owned(),
        );
    }
    if object.of_frame(frame, tags::PIXEL_SPACING).is_none() {
        notes.push("the distance of pixels is not in the file: 1 mm is used".to_owned());
    }
}

/// The channel's name and what its values are multiplied with.
fn meaning(modality: &str, object: &Object, notes: &mut Vec<String>) -> (&'static str, f64) {
    match modality {
        "CT" => ("ct", 1.0),
        "MR" => ("mr", 1.0),
        "PT" => match object.top.text(tags::UNITS).as_deref() {
            Some("GML") => ("suv", 1.0),
            Some("BQML") => match suv::factor(object) {
                Ok(factor) => {
                    notes.push(format!(
                        "Bq/ml became standardised uptake values (g/ml, by body weight): multiplied with {factor:.6e}"
                    ));
                    ("suv", factor)
                }
                Err(missing) => {
                    notes.push(format!("values stay in Bq/ml, no standardised uptake: {missing}"));
                    ("pet", 1.0)
                }
            },
            _ => {
                notes.push("values are in units of the scanner, no standardised uptake".to_owned());
                ("pet", 1.0)
            }
        },
        _ => ("image", 1.0),
    }
}

/// Lowest and highest value of the window that the file suggests.
fn window(object: &Object, frame: usize, factor: f64) -> Option<[f64; 2]> {
    let number = |tag| object.of_frame(frame, tag).and_then(|n| n.first().copied());
    let (centre, width) = (number(tags::WINDOW_CENTRE)? * factor, number(tags::WINDOW_WIDTH)? * factor);
    (width > 0.0).then_some([centre - width / 2.0, centre + width / 2.0])
}

/// Who the patient is, for those who asked.
fn identity(object: &Object) -> Vec<(&'static str, String)> {
    [
        ("name", tags::PATIENT_NAME),
        ("identifier", tags::PATIENT_ID),
        ("birth date", tags::PATIENT_BIRTH_DATE),
        ("sex", tags::PATIENT_SEX),
    ]
    .into_iter()
    .filter_map(|(what, tag)| Some((what, object.top.text(tag)?.replace(char::is_control, "\u{fffd}"))))
    .collect()
}

/// The type that takes the numbers of all slices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum HeldAs {
    U8,
    I16,
    U16,
    F64,
}

impl HeldAs {
    fn of(images: &[Image<'_>], stack: &Stack, scales: &[[f64; 2]]) -> Self {
        let ranges = stack.slices.iter().map(|s| images[s.object].layout.range());
        let [low, high] = ranges.fold([0, 0], |[low, high], [l, h]| [low.min(l), high.max(h)]);
        let fits = |range: [i64; 2]| range[0] <= low && high <= range[1];
        if scales.iter().any(|scale| *scale != scales[0]) {
            Self::F64
        } else if fits([0, 255]) {
            Self::U8
        } else if images[stack.slices[0].object].layout.signed && fits([-32_768, 32_767]) {
            Self::I16
        } else if fits([0, 65_535]) {
            Self::U16
        } else if fits([-32_768, 32_767]) {
            Self::I16
        } else {
            Self::F64
        }
    }

    fn bytes(self) -> u128 {
        match self {
            Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::F64 => 8,
        }
    }
}

/// Everything that is needed to read the samples.
struct Reading<'a> {
    path: &'a str,
    files: &'a Files<'a>,
    images: &'a [Image<'a>],
    stack: &'a Stack,
    scales: &'a [[f64; 2]],
    options: &'a LoadOptions,
}

impl Reading<'_> {
    /// Reads and decodes all slices on all cores, each into its place.
    fn read<T: Held>(&self) -> Result<(Buffer<T>, f64), LoadError> {
        let [columns, rows, _] = self.stack.grid.dims().map(|n| n as usize);
        let slice_length = columns * rows;
        let places = &self.stack.places;
        let mut voxels: Buffer<T> = zeroed_buffer(self.path, slice_length * places.len())?;
        let done = AtomicUsize::new(0);
        // What lies between the same two slices is made together, so that each is decoded at most twice.
        let mut work = Vec::new();
        let mut rest = &mut *voxels;
        for between in places.chunk_by(|a, b| a.0 == b.0) {
            let (here, after) = rest.split_at_mut(between.len() * slice_length);
            work.push((between, here));
            rest = after;
        }
        let rounding = work
            .into_par_iter()
            .map(|(between, here)| {
                let worst = self.read_between(between, here, slice_length)?;
                let done = done.fetch_add(between.len(), Ordering::Relaxed) + between.len();
                self.options.progressed(done as f32 / places.len() as f32);
                Ok(worst)
            })
            .try_reduce(|| 0.0, |a: f64, b| Ok(a.max(b)))?;
        Ok((voxels, rounding))
    }

    fn read_between<T: Held>(
        &self,
        between: &[(usize, f64)],
        here: &mut [T],
        slice_length: usize,
    ) -> Result<f64, LoadError> {
        let Some(&(before, _)) = between.first() else { return Ok(0.0) };
        if let [(_, 0.0)] = between {
            return self.read_slice(before, here);
        }
        let mut pair = [zeroed(self.path, slice_length)?, zeroed(self.path, slice_length)?];
        for (slice, place) in (before..).zip(&mut pair) {
            self.read_slice(slice, place)?;
        }
        let [a, b] = pair;
        // Of what is between the slices: that may lose what neither of them does.
        let mut worst = 0.0f64;
        for (&(_, part), place) in between.iter().zip(here.chunks_exact_mut(slice_length)) {
            for ((place, &a), &b) in place.iter_mut().zip(&a).zip(&b) {
                *place = T::mixed(a, b, part);
                worst = worst.max(place.lost_as_single());
            }
        }
        Ok(worst)
    }

    fn read_slice<T: Held>(&self, slice: usize, place: &mut [T]) -> Result<f64, LoadError> {
        // The slice after the last has a part of 0 in what is made of it.
        let slice = slice.min(self.stack.slices.len() - 1);
        let Slice { object, frame, .. } = self.stack.slices[slice];
        let Image { object, layout, frames } = self.images[object];
        pixels::read(self.files, Frame { object, frame, frames, layout, scale: self.scales[slice] }, place)
    }
}
