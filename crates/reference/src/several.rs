//! Emission and absorption of several volumes along a ray.

use crate::beam::{Beam, Matter, PICTURE_ERROR};
use crate::emission::Shine;
use crate::ray::{Passage, Way};
use crate::transfer::{Stretch, Stretches};
use crate::{Cubic, Field, Pixel, Ray, ReferenceError, labels};
use scene::{Further, Headlight, LabelLooks};
use spatial::{DAffine3, DVec3};
use volume::{Channel, ChannelKind, Volume};

/// A volume beside the first, on its own grid.
#[derive(Clone, Debug)]
pub(crate) struct Part<'a> {
    field: Field<'a>,
    transfer: Stretches,
    labels: Option<&'a LabelLooks>,
    light: Option<&'a Headlight>,
    index_from_first_index: DAffine3,
    /// Its largest value over that of the first volume: an uncertainty is a part of each.
    values_per_value: f64,
}

impl<'a> Part<'a> {
    /// Puts a further volume in register with the first.
    pub(crate) fn new(
        volumes: &[&'a Volume],
        first: &Field<'_>,
        further: &'a Further,
    ) -> Result<Self, ReferenceError> {
        let (wanted, found) = (further.volume, volumes.len());
        let (Some(&volume), Some(of_first)) = (volumes.get(wanted), volumes.first()) else {
            return Err(ReferenceError::NoSuchVolume { wanted, found });
        };
        let channel = channel_of(volume, further.channel, further.labels.is_some())?;
        let grid = further.grid(volume.grid())?;
        let field = Field::new(channel, &grid);
        let (own, others) = (field.largest_magnitude(), first.largest_magnitude());
        Ok(Self {
            transfer: Stretches::of(&further.transfer),
            labels: further.labels.as_ref(),
            light: further.light.as_ref(),
            index_from_first_index: grid.volume_from_index().inverse() * of_first.grid().volume_from_index(),
            values_per_value: if others > 0.0 { own / others } else { 1.0 },
            field,
        })
    }

    /// The same with every value higher by as large a part as the first volume's are by `offset`.
    pub(crate) fn raised(&self, offset: f64) -> Self {
        Self { field: self.field.raised(offset * self.values_per_value), ..self.clone() }
    }

    /// The corners of its border, as index of the first volume.
    pub(crate) fn corners_in_first_index(&self) -> [DVec3; 8] {
        let first_index_from_index = self.index_from_first_index.inverse();
        self.field.border().map(|corner| first_index_from_index.transform_point3(corner))
    }

    /// A ray of the first volume in this one. Both measure in the millimetres of the patient.
    fn ray(&self, of_first: &Ray) -> Ray {
        Ray {
            origin: self.index_from_first_index.transform_point3(of_first.origin),
            direction: self.index_from_first_index.matrix3 * of_first.direction,
        }
    }
}

/// The channel of a volume, if it can be shown as labels or as values.
pub(crate) fn channel_of(
    volume: &Volume,
    wanted: usize,
    as_labels: bool,
) -> Result<&Channel, ReferenceError> {
    let channels = volume.channels();
    let channel =
        channels.get(wanted).ok_or(ReferenceError::NoSuchChannel { wanted, found: channels.len() })?;
    let count = (0..channel.voxels.len()).filter(|&at| !channel.value(at).is_finite()).count();
    if count > 0 {
        return Err(ReferenceError::NotFinite { channel: channel.name.clone(), count });
    }
    if as_labels != (channel.kind == ChannelKind::Label) {
        return Err(ReferenceError::Kind { channel: channel.name.clone() });
    }
    Ok(channel)
}

/// What one volume shows of a ray.
#[derive(Clone, Copy)]
pub(crate) struct Shown<'a> {
    pub(crate) field: &'a Field<'a>,
    pub(crate) transfer: &'a Stretches,
    /// What each label does to light, where the field holds labels.
    pub(crate) labels: Option<&'a LabelLooks>,
    pub(crate) light: Option<&'a Headlight>,
}

/// A stretch of a ray in which one volume is seen, and smooth.
struct Piece<'a> {
    way: Way,
    holds: Holds<'a>,
}

/// What a piece holds.
enum Holds<'a> {
    /// A label: the same all through.
    Label(Matter),
    /// Values that run through a cell, in one stretch of the transfer function.
    Values { passage: Passage, value: Cubic, stretch: &'a Stretch, shine: Option<Box<Shine<'a>>> },
}

impl Piece<'_> {
    fn matter(&self, at_mm: f64) -> Matter {
        let (passage, value, stretch, shine) = match &self.holds {
            Holds::Label(matter) => return *matter,
            Holds::Values { passage, value, stretch, shine } => (passage, value, stretch, shine),
        };
        let u = ((at_mm - passage.way.from_mm) / passage.way.length_mm()).clamp(0.0, 1.0);
        let optical = stretch.optical(value.at(u));
        let color = match shine {
            Some(shine) => shine.lit(optical.color, u),
            None => optical.color,
        };
        Matter { color, extinction_per_mm: optical.extinction_per_mm() }
    }
}

/// Integrates the union of volumes along a ray: extinctions add, and so does the light that each gives off. The ray is cut
/// wherever one of them is cut when it stands alone, so that the sum is smooth between cuts.
pub(crate) fn pixel(first: Shown<'_>, parts: &[Part<'_>], ray: &Ray, depth_at: f64) -> Pixel {
    let mut all = vec![pieces(first, ray)];
    for part in parts {
        let shown =
            Shown { field: &part.field, transfer: &part.transfer, labels: part.labels, light: part.light };
        all.push(pieces(shown, &part.ray(ray)));
    }
    let ends = |piece: &Piece<'_>| [piece.way.from_mm, piece.way.to_mm];
    let mut cuts: Vec<f64> = all.iter().flatten().flat_map(ends).collect();
    cuts.sort_by(f64::total_cmp);
    let (Some(&begin), Some(&end)) = (cuts.first(), cuts.last()) else { return Pixel::NOTHING };
    let error_per_mm = PICTURE_ERROR / (end - begin);
    let mut beam = Beam::seeking(depth_at);
    let mut depth_mm = None;
    let mut next = vec![0; all.len()];
    for pair in cuts.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        if to <= from {
            continue;
        }
        let middle = from + (to - from) / 2.0;
        let mut here: Vec<&Piece<'_>> = Vec::new();
        for (pieces, next) in all.iter().zip(&mut next) {
            while pieces.get(*next).is_some_and(|piece| piece.way.to_mm <= middle) {
                *next += 1;
            }
            here.extend(pieces.get(*next).filter(|piece| piece.way.from_mm < middle));
        }
        if here.is_empty() {
            continue;
        }
        let matter = |at_mm: f64| {
            let mut sum = Matter { color: [0.0; 3], extinction_per_mm: 0.0 };
            for one in here.iter().map(|piece| piece.matter(at_mm)) {
                sum.extinction_per_mm += one.extinction_per_mm;
                for (sum, c) in sum.color.iter_mut().zip(one.color) {
                    *sum += c * one.extinction_per_mm;
                }
            }
            if sum.extinction_per_mm > 0.0 {
                sum.color = sum.color.map(|c| c / sum.extinction_per_mm);
            }
            sum
        };
        let reached = beam.pass(from, to, 1.0, error_per_mm * (to - from), &matter);
        depth_mm = depth_mm.or(reached);
        if beam.is_spent() {
            break;
        }
    }
    let [r, g, b] = beam.color();
    Pixel { rgba: [r, g, b, beam.alpha()], depth_mm }
}

/// Where a volume is seen along a ray, in order: cell by cell, each cut where the value passes a knot of the transfer
/// function and where the gradient turns from facing the ray to facing away.
fn pieces<'a>(shown: Shown<'a>, ray: &Ray) -> Vec<Piece<'a>> {
    let Shown { field, transfer, labels, light } = shown;
    if let Some(looks) = labels {
        let piece = |voxel: labels::Voxel| Piece { way: voxel.way, holds: Holds::Label(voxel.matter) };
        return labels::voxels(field, looks, light, ray).into_iter().map(piece).collect();
    }
    let mut found = Vec::new();
    let Some(way) = ray.inside(field.dims()) else { return found };
    let mut cuts = Vec::new();
    for passage in ray.cells(field.dims(), way) {
        let corners = field.corners(passage.cell);
        let low = corners.iter().copied().fold(f64::INFINITY, f64::min);
        let high = corners.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if !transfer.is_visible_within(low, high) {
            continue;
        }
        let value = Cubic::across(&corners, passage.from, passage.to);
        let shine = light.map(|light| Box::new(Shine::new(light, field, ray, &passage)));
        cuts.clear();
        transfer.crossings(&value, low, high, &mut cuts);
        if let Some(shine) = &shine {
            shine.cosine_kinks(&mut cuts);
        }
        cuts.sort_by(f64::total_cmp);
        cuts.push(1.0);
        let mut from = 0.0;
        for &to in cuts.iter().filter(|&&to| to > 0.0) {
            let stretch = transfer.at(value.at(from + (to - from) / 2.0));
            let way = Way { from_mm: passage.mm(from), to_mm: passage.mm(to) };
            if way.to_mm > way.from_mm && stretch.is_visible() {
                let holds = Holds::Values { passage, value, stretch, shine: shine.clone() };
                found.push(Piece { way, holds });
            }
            from = to;
        }
    }
    found
}
