//! Frames in their order along the slice axis, and the grid that they make.

use super::files::Files;
use super::object::Object;
use super::suv::time_secs;
use super::tags;
use crate::{LoadError, LoadOptions, Sequence};
use dicom_core::Tag;
use spatial::{DAffine3, DMat3, DVec3};
use std::cmp::Ordering;
use volume::Grid;

/// Frames whose axes differ by more than this (unit vectors) are of different stacks.
const SAME_DIRECTION: f64 = 1.0e-3;
/// As much may the distance of pixels differ, as a part of it.
const SAME_SPACING: f64 = 1.0e-4;
/// Slices nearer to each other than this, in millimetres, are at one place.
const SAME_PLACE_MM: f64 = 1.0e-3;
/// How far from its even place a slice may lie, as a part of the distance of slices: what scanners round away.
const EVEN: f64 = 0.01;
/// A lean of the slice axis that is noted, in degrees.
const TILTED_DEG: f64 = 0.05;
/// How far a slice may lie beside the line through the first and the last, in millimetres, before it is noted.
const BESIDE_MM: f64 = 0.1;
/// How often an uneven stack is divided at most, compared with its slices.
const MOST_DIVIDED: f64 = 4.0;
/// Names in one note.
const NAMED: usize = 6;
/// Gaps that are named, equal ones in a row as one: more is a page that nobody reads.
const GAPS_NAMED: usize = 32;

/// One frame and where it is.
#[derive(Clone)]
pub(super) struct Slice {
    /// Which of the objects.
    pub(super) object: usize,
    pub(super) frame: usize,
    /// Rows and columns.
    size: [usize; 2],
    /// From one column to the next, in millimetres of the patient (LPS).
    x: DVec3,
    /// From one row to the next.
    y: DVec3,
    /// The first pixel; not every multi-frame object says where its frames are.
    first: Option<DVec3>,
    /// What orders slices at one place.
    order: Order,
}

/// What orders slices at one place, the first that differs: steps in time as the file counts them, its times, its number.
#[derive(Clone, Copy, Default)]
struct Order {
    step: f64,
    position: f64,
    /// After the heart's trigger.
    trigger_secs: f64,
    /// Of the day.
    acquired_secs: f64,
    number: f64,
}

impl Order {
    fn of(object: &Object, frame: usize) -> Self {
        let number = |tag| object.top.number(tag).unwrap_or(0.0);
        let acquired = object.top.text(tags::ACQUISITION_TIME).and_then(|text| time_secs(&text));
        Self {
            step: object.step_of_frame(frame).unwrap_or(0.0),
            position: number(tags::TEMPORAL_POSITION),
            trigger_secs: number(tags::TRIGGER_TIME) / 1000.0,
            acquired_secs: acquired.unwrap_or(0.0),
            number: number(tags::INSTANCE_NUMBER),
        }
    }

    fn compare(&self, other: &Self) -> Ordering {
        let parts = |o: &Self| [o.step, o.position, o.trigger_secs, o.acquired_secs, o.number];
        parts(self)
            .iter()
            .zip(parts(other))
            .map(|(a, b)| a.total_cmp(&b))
            .find(|o| o.is_ne())
            .unwrap_or(Ordering::Equal)
    }
}

/// The frames of a stack, each at its own place, from the first on along the normal of the slices.
pub(super) struct Stack {
    pub(super) slices: Vec<Slice>,
    pub(super) grid: Grid,
    /// For each slice of the grid: the slice before it and how far it is on the way to the next.
    pub(super) places: Vec<(usize, f64)>,
    /// The series in time that the slices are one step of.
    pub(super) sequence: Option<Sequence>,
}

impl Slice {
    pub(super) fn of(
        file: &str,
        object: &Object,
        index: usize,
        frame: usize,
        size: [usize; 2],
    ) -> Result<Self, LoadError> {
        let vector = |field: &'static str, tag: Tag, count: usize| match object.of_frame(frame, tag) {
            None => Ok(None),
            Some(numbers) if numbers.len() == count => Ok(Some(numbers)),
            Some(numbers) => {
                Err(LoadError::field(file, field, format!("{count} numbers"), &format!("{numbers:?}")))
            }
        };
        let three = |n: &[f64]| DVec3::new(n[0], n[1], n[2]);
        let axes = vector("Image Orientation (Patient)", tags::IMAGE_ORIENTATION, 6)?;
        let [along_row, along_column] = axes.map_or([DVec3::X, DVec3::Y], |n| [three(&n), three(&n[3..])]);
        for axis in [along_row, along_column] {
            if !(0.9..=1.1).contains(&axis.length()) {
                let expected = "two directions of length 1";
                return Err(LoadError::field(file, "Image Orientation (Patient)", expected, &axis));
            }
        }
        let spacing = vector("Pixel Spacing", tags::PIXEL_SPACING, 2)?.unwrap_or_else(|| vec![1.0; 2]);
        let first = vector("Image Position (Patient)", tags::IMAGE_POSITION, 3)?.map(|n| three(&n));
        let offsets = object.top.numbers(tags::FRAME_OFFSETS);
        let normal = along_row.cross(along_column).normalize_or_zero();
        let offset = offsets.and_then(|offsets| offsets.get(frame).copied()).map(|offset| offset * normal);
        // Without a place for each frame, the file's own is that of its first.
        let own = object.per_frame.get(frame).is_some() || object.per_frame.is_empty() && frame == 0;
        let first = match offset {
            Some(offset) => first.map(|first| first + offset),
            None => first.filter(|_| own),
        };
        Ok(Self {
            object: index,
            frame,
            size,
            x: along_row.normalize() * spacing[1],
            y: along_column.normalize() * spacing[0],
            first,
            order: Order::of(object, frame),
        })
    }

    fn normal(&self) -> DVec3 {
        self.x.cross(self.y).normalize_or_zero()
    }

    fn is_parallel_to(&self, other: &Self) -> bool {
        let near = |a: DVec3, b: DVec3| {
            (a.normalize_or_zero() - b.normalize_or_zero()).length() < SAME_DIRECTION
                && (a.length() - b.length()).abs() <= SAME_SPACING * b.length()
        };
        self.size == other.size && near(self.x, other.x) && near(self.y, other.y)
    }
}

/// Names files in notes.
pub(super) struct Names<'a, 'f> {
    pub(super) files: &'a Files<'f>,
    pub(super) objects: &'a [&'a Object],
}

impl Names<'_, '_> {
    pub(super) fn of(&self, slice: &Slice) -> String {
        let object = self.objects[slice.object];
        let name = self.files.name(object.file);
        if slice.frame > 0 || !object.per_frame.is_empty() {
            format!("{name} frame {}", slice.frame + 1)
        } else {
            name
        }
    }

    fn some(&self, slices: &[Slice]) -> String {
        let names: Vec<String> = slices.iter().take(NAMED).map(|s| self.of(s)).collect();
        let more =
            if slices.len() > NAMED { format!(" and {} more", slices.len() - NAMED) } else { String::new() };
        format!("{}{more}", names.join(", "))
    }
}

impl Stack {
    /// Puts the frames of a series in order. What does not belong together is left out and noted.
    pub(super) fn of(
        file: &str,
        options: &LoadOptions,
        frames: Vec<Slice>,
        names: &Names<'_, '_>,
        notes: &mut Vec<String>,
    ) -> Result<Self, LoadError> {
        let mut slices = largest_group(frames, names, notes);
        place_frames(&mut slices, names.objects, notes);
        let normal = slices[0].normal();
        let along = |s: &Slice| s.first.map_or(0.0, |first| first.dot(normal));
        slices.sort_by(|a, b| along(a).total_cmp(&along(b)));
        let (slices, sequence) = one_a_place(file, options, slices, along, names, notes)?;
        let at_mm: Vec<f64> = slices.iter().map(along).collect();
        let count = slices.len();
        let (first, last) = (&slices[0], &slices[count - 1]);
        let origin = first.first.unwrap_or(DVec3::ZERO);
        let extent_mm = at_mm[count - 1] - at_mm[0];

        // From one millimetre along the normal to the next, along the way that the slices took.
        let axis = match last.first {
            Some(last) if count > 1 => (last - origin) / extent_mm,
            _ => normal,
        };
        let lean_deg = axis.angle_between(normal).to_degrees();
        if lean_deg > TILTED_DEG {
            notes.push(format!(
                "the slices are shifted against each other, by a gantry tilt of {lean_deg:.1}°: the grid is sheared \
                 to match, without resampling within slices"
            ));
        }
        let beside_mm = slices
            .iter()
            .zip(&at_mm)
            .filter_map(|(s, at)| Some((s.first? - (origin + (at - at_mm[0]) * axis)).length()))
            .fold(0.0, f64::max);
        if beside_mm > BESIDE_MM {
            notes.push(format!("slices lie up to {beside_mm:.2} mm beside one line: they are shown on it"));
        }

        let (step_mm, places) = if count == 1 {
            (thickness_mm(&slices[0], names.objects, notes), vec![(0, 0.0)])
        } else {
            places(&at_mm, &slices, names, notes)
        };
        let dims = [slices[0].size[1], slices[0].size[0], places.len()].map(|n| n as u32);
        let matrix3 = DMat3::from_cols(slices[0].x, slices[0].y, axis * step_mm);
        let grid = Grid::new(dims, DAffine3 { matrix3, translation: origin });
        let grid = grid.map_err(|source| LoadError::Grid {
            file: file.to_owned(),
            field: "position, orientation and spacing of the slices",
            source,
        })?;
        Ok(Self { slices, grid, places, sequence })
    }
}

/// Of frames that lie in different directions or have different sizes, as a localiser and its series, the most.
fn largest_group(frames: Vec<Slice>, names: &Names<'_, '_>, notes: &mut Vec<String>) -> Vec<Slice> {
    let mut groups: Vec<Vec<Slice>> = Vec::new();
    for frame in frames {
        match groups.iter_mut().find(|group| group[0].is_parallel_to(&frame)) {
            Some(group) => group.push(frame),
            None => groups.push(vec![frame]),
        }
    }
    // The first of the largest, so that the choice does not depend on the order of files.
    groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
    let mut groups = groups.into_iter();
    let largest = groups.next().unwrap_or_default();
    for group in groups {
        let [rows, columns] = group[0].size;
        notes.push(format!(
            "{} images of {columns} × {rows} px have another size, orientation or pixel spacing than the other {} and \
             were left out: {}",
            group.len(),
            largest.len(),
            names.some(&group)
        ));
    }
    largest
}

/// Frames that do not say where they are follow each other at the distance that their file gives.
fn place_frames(slices: &mut [Slice], objects: &[&Object], notes: &mut Vec<String>) {
    let without = slices.iter().filter(|s| s.first.is_none()).count();
    if without == 0 {
        return;
    }
    notes.push(format!(
        "{without} of {} images do not say where they are: they are taken to follow each other",
        slices.len()
    ));
    let step_mm = thickness_mm(&slices[0], objects, notes);
    let normal = slices[0].normal();
    let origin = slices.iter().find_map(|s| s.first).unwrap_or(DVec3::ZERO);
    slices.sort_by(|a, b| a.order.number.total_cmp(&b.order.number).then(a.frame.cmp(&b.frame)));
    for (i, slice) in slices.iter_mut().enumerate() {
        slice.first = Some(origin + i as f64 * step_mm * normal);
    }
}

/// Distance of slices as the file says, where positions do not.
fn thickness_mm(slice: &Slice, objects: &[&Object], notes: &mut Vec<String>) -> f64 {
    let object = objects[slice.object];
    let said = [tags::SPACING_BETWEEN_SLICES, tags::SLICE_THICKNESS]
        .into_iter()
        .find_map(|tag| object.of_frame(slice.frame, tag)?.first().map(|mm| mm.abs()).filter(|mm| *mm > 0.0));
    said.unwrap_or_else(|| {
        notes.push("the distance of slices is not in the file: 1 mm is used".to_owned());
        1.0
    })
}

/// Of images at one place, the one of the step that was asked for, in time and number.
fn one_a_place(
    file: &str,
    options: &LoadOptions,
    slices: Vec<Slice>,
    along: impl Fn(&Slice) -> f64,
    names: &Names<'_, '_>,
    notes: &mut Vec<String>,
) -> Result<(Vec<Slice>, Option<Sequence>), LoadError> {
    let total = slices.len();
    let mut at_places: Vec<Vec<Slice>> = Vec::new();
    for slice in slices {
        match at_places.last_mut().filter(|place| (along(&place[0]) - along(&slice)).abs() < SAME_PLACE_MM) {
            Some(place) => place.push(slice),
            None => at_places.push(vec![slice]),
        }
    }
    let times = at_places[0].len();
    let is_series = times > 1 && at_places.iter().all(|place| place.len() == times);
    let steps = if is_series { times as u64 } else { 1 };
    Sequence::check(file, steps, options)?;
    let time = options.time;
    let mut step_secs = None;
    let (mut kept, mut others) = (Vec::with_capacity(at_places.len()), Vec::new());
    for mut place in at_places {
        place.sort_by(|a, b| a.order.compare(&b.order).then(a.frame.cmp(&b.frame)));
        if is_series {
            // The first and the last of the first place tell how far apart they are.
            step_secs = step_secs.or_else(|| step_secs_of(&place));
            kept.push(place.swap_remove(time as usize));
        } else {
            let mut place = place.into_iter();
            kept.extend(place.next());
            others.extend(place);
        }
    }
    if is_series {
        let sequence = Sequence { steps: times as u64, loaded: time, step_secs };
        notes.push(format!(
            "each of {} places has {times} images, {total} in all: {}",
            kept.len(),
            sequence.note()
        ));
        return Ok((kept, Some(sequence)));
    }
    if !others.is_empty() {
        notes.push(format!(
            "{} images are at the place of another and were left out: {}",
            others.len(),
            names.some(&others)
        ));
    }
    Ok((kept, None))
}

/// Seconds from one image at a place to the next, on the mean, by the times that differ.
fn step_secs_of(place: &[Slice]) -> Option<f64> {
    let (first, last) = (place.first()?.order, place.last()?.order);
    [last.trigger_secs - first.trigger_secs, last.acquired_secs - first.acquired_secs]
        .into_iter()
        .find(|secs| *secs > 0.0)
        .map(|secs| secs / (place.len() - 1) as f64)
}

/// The distance of slices and where each slice of the grid comes from. Even slices stay what they are; uneven ones are
/// resampled along the slice axis at their smallest distance.
fn places(
    at_mm: &[f64],
    slices: &[Slice],
    names: &Names<'_, '_>,
    notes: &mut Vec<String>,
) -> (f64, Vec<(usize, f64)>) {
    let count = at_mm.len();
    let extent_mm = at_mm[count - 1] - at_mm[0];
    let mean_mm = extent_mm / (count - 1) as f64;
    let off_mm = (0..count).map(|i| (at_mm[i] - at_mm[0] - i as f64 * mean_mm).abs()).fold(0.0, f64::max);
    if off_mm <= EVEN * mean_mm {
        if off_mm > SAME_PLACE_MM {
            notes.push(format!("slices lie up to {off_mm:.4} mm off even places: taken as even"));
        }
        return (mean_mm, (0..count).map(|i| (i, 0.0)).collect());
    }
    let gaps_mm: Vec<f64> = at_mm.windows(2).map(|w| w[1] - w[0]).collect();
    let mut sorted = gaps_mm.clone();
    sorted.sort_by(f64::total_cmp);
    let (least_mm, usual_mm) = (sorted[0], sorted[sorted.len() / 2]);
    note_gaps(&gaps_mm, usual_mm, slices, names, notes);

    let aimed_mm = least_mm.max(mean_mm / MOST_DIVIDED);
    let steps = (extent_mm / aimed_mm).round().max(1.0);
    let step_mm = extent_mm / steps;
    let mut before = 0;
    let mut kept = 0;
    let places: Vec<(usize, f64)> = (0..=steps as usize)
        .map(|i| {
            let at = at_mm[0] + i as f64 * step_mm;
            while before + 1 < count && at_mm[before + 1] <= at + SAME_PLACE_MM {
                before += 1;
            }
            let part = if before + 1 < count { (at - at_mm[before]) / gaps_mm[before] } else { 0.0 };
            if (at - at_mm[before]).abs() < SAME_PLACE_MM {
                kept += 1;
                (before, 0.0)
            } else {
                (before, part)
            }
        })
        .collect();
    notes.push(format!(
        "uneven distances of slices, {least_mm:.3} to {:.3} mm: resampled along the slice axis to {} slices every \
         {step_mm:.4} mm, by linear interpolation; {kept} of {count} slices are kept as they are",
        sorted[sorted.len() - 1],
        places.len()
    ));
    (step_mm, places)
}

/// Names the slices beside gaps that are not as usual, those of equal gaps in a row together.
fn note_gaps(
    gaps_mm: &[f64],
    usual_mm: f64,
    slices: &[Slice],
    names: &Names<'_, '_>,
    notes: &mut Vec<String>,
) {
    let near = |a: f64, b: f64| (a - b).abs() <= EVEN * usual_mm;
    let (mut first, mut named, mut more) = (0, 0, 0);
    for alike in gaps_mm.chunk_by(|a, b| near(*a, *b)) {
        let (start, end) = (first, first + alike.len());
        first = end;
        let gap_mm = alike[0];
        if near(gap_mm, usual_mm) {
            continue;
        }
        if named == GAPS_NAMED {
            more += 1;
            continue;
        }
        named += 1;
        let times = gap_mm / usual_mm;
        let missing = times.round() - 1.0;
        let what = if missing >= 1.0 && (times - times.round()).abs() < 0.05 {
            format!("{missing} missing")
        } else {
            format!("{usual_mm:.3} mm is usual")
        };
        let [a, b] = [&slices[start], &slices[end]].map(|s| names.of(s));
        let often = if alike.len() > 1 { format!("{} times ", alike.len()) } else { String::new() };
        notes.push(format!("between {a} and {b} are {often}{gap_mm:.3} mm: {what}"));
    }
    if more > 0 {
        notes.push(format!("{more} more distances are not as usual"));
    }
}
