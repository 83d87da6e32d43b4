//! A decoded picture against the exact one.

use crate::offset_px;
use reference::{Picture, RaySetup, Reference, ReferenceError, compare};
use scene::Scene;
use serde::Serialize;
use spatial::{DAffine3, DVec3, EyeView, StereoView};
use volume::{Grid, Volume};

/// What an eye pair was shown, as it was decoded.
#[derive(Clone, Debug, PartialEq)]
pub struct Shown {
    /// The view that the picture was made for, as its header says.
    pub rendered: StereoView,
    /// Where the eyes truly were when it was seen.
    pub seen_from: StereoView,
    /// Width and height of one eye's picture, in pixels.
    pub eye_size_px: [u32; 2],
    /// Red, green and blue of the left and of the right eye, three bytes a pixel, rows from the top.
    pub rgb8: [Vec<u8>; 2],
}

/// How far a picture is from another: both eyes, red, green and blue, from 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PictureError {
    /// `-20·log₁₀(rmse)`, decibels; `None` where the pictures are equal.
    pub psnr_db: Option<f64>,
    /// Root of the mean square difference.
    pub rmse: f64,
    /// The largest difference.
    pub max: f64,
}

/// What came of looking at a picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// Against the exact picture of the view that it was made for: what renderer and codec did to it.
    pub at_rendered_pose: PictureError,
    /// Against the exact picture of where the eyes were when it was seen: what the viewer gets, without reprojection.
    pub at_display_pose: PictureError,
    /// How far the picture is shifted against that of the view that it was made for, in pixels: the farther eye.
    /// `None` where pictures do not tell.
    pub offset_px: Option<f64>,
    /// The same against that of where the eyes were when it was seen.
    pub display_offset_px: Option<f64>,
}

/// Why a picture was not verified.
#[derive(Debug, thiserror::Error)]
pub enum VerifyError {
    /// The exact picture could not be made, or the decoded one is none.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// Not three bytes a pixel.
    #[error("a decoded eye has {found} bytes, expected {expected} for {width}x{height} pixels")]
    Length {
        /// Bytes as found.
        found: usize,
        /// Three a pixel.
        expected: usize,
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
    },
}

/// Makes the exact pictures of a scene in the room.
#[derive(Clone, Debug)]
pub struct Exact<'a> {
    reference: Reference<'a>,
    grid: &'a Grid,
    volume_from_world: DAffine3,
}

impl<'a> Exact<'a> {
    /// Takes what the server shows too.
    ///
    /// # Errors
    /// If the volume has no such channel, or samples of it are not finite.
    pub fn new(volume: &'a Volume, scene: &'a Scene) -> Result<Self, ReferenceError> {
        Self::of_several(volume, &[], scene)
    }

    /// The same with the volumes beside the first, in the order in which the scene counts them.
    ///
    /// # Errors
    /// If a volume is not there or has no such channel, samples are not finite, or a registration leaves no grid.
    pub fn of_several(
        volume: &'a Volume,
        others: &[&'a Volume],
        scene: &'a Scene,
    ) -> Result<Self, ReferenceError> {
        let grid = volume.grid();
        let volume_from_world = scene.placement.world_from_volume(grid).inverse();
        let volumes: Vec<&Volume> = std::iter::once(volume).chain(others.iter().copied()).collect();
        Ok(Self { reference: Reference::of_several(&volumes, scene)?, grid, volume_from_world })
    }

    /// The middle of the volume and its eight corners, in the room.
    #[must_use]
    pub fn anchors_in_world(&self) -> Vec<DVec3> {
        let world_from_texture =
            self.volume_from_world.inverse() * self.grid.volume_from_index() * self.grid.index_from_texture();
        let corner = |i: u32| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2 & 1));
        let places = std::iter::once(DVec3::splat(0.5)).chain((0..8).map(corner));
        places.map(|at| world_from_texture.transform_point3(at)).collect()
    }

    /// What an eye in the room sees, before the scene's background.
    ///
    /// # Errors
    /// If the picture has no pixel.
    pub fn picture(&self, eye: EyeView, [width, height]: [u32; 2]) -> Result<Picture, ReferenceError> {
        let setup = RaySetup::in_room(self.grid, self.volume_from_world, eye);
        let picture = self.reference.picture(&setup, width, height, &|_| {})?;
        Ok(picture.over(self.reference.scene().background))
    }

    /// Holds a decoded pair of pictures against the exact ones of both views.
    ///
    /// # Errors
    /// If the bytes are not those of the size.
    pub fn verify(&self, shown: &Shown) -> Result<Verdict, VerifyError> {
        let found = [0, 1].map(|eye| decoded(&shown.rgb8[eye], shown.eye_size_px));
        let [left, right] = found;
        let found = [left?, right?];
        let (at_rendered_pose, offset_px) = self.against(&found, &shown.rendered)?;
        let (at_display_pose, display_offset_px) = self.against(&found, &shown.seen_from)?;
        Ok(Verdict { at_rendered_pose, at_display_pose, offset_px, display_offset_px })
    }

    fn against(
        &self,
        found: &[Picture; 2],
        view: &StereoView,
    ) -> Result<(PictureError, Option<f64>), ReferenceError> {
        let size_px = [found[0].width(), found[0].height()];
        let exact = [self.picture(view.eyes[0], size_px)?, self.picture(view.eyes[1], size_px)?];
        let offset = |eye: usize| offset_px(&found[eye], &exact[eye]).map(|[x, y]| x.hypot(y));
        let farther = offset(0).zip(offset(1)).map(|(left, right)| left.max(right));
        Ok((PictureError::of([(&found[0], &exact[0]), (&found[1], &exact[1])])?, farther))
    }
}

impl PictureError {
    /// How far pictures of one size are apart, all pairs together.
    ///
    /// # Errors
    /// If two of a pair have different sizes.
    pub fn of<const PAIRS: usize>(pairs: [(&Picture, &Picture); PAIRS]) -> Result<Self, ReferenceError> {
        let (mut squares, mut max) = (0.0, 0.0f64);
        for (found, exact) in pairs {
            squares += compare(found, exact)?.rmse.powi(2) / PAIRS as f64;
            // Opacity, which a decoded picture has none of, does not count.
            let largest = |(a, b): (&reference::Pixel, &reference::Pixel)| {
                (0..3).map(|c| (a.rgba[c] - b.rgba[c]).abs()).fold(0.0, f64::max)
            };
            max = found.pixels().iter().zip(exact.pixels()).map(largest).fold(max, f64::max);
        }
        let rmse = squares.sqrt();
        Ok(Self { psnr_db: (rmse > 0.0).then(|| -20.0 * rmse.log10()), rmse, max })
    }
}

fn decoded(rgb8: &[u8], [width, height]: [u32; 2]) -> Result<Picture, VerifyError> {
    let expected = 3 * width as usize * height as usize;
    if rgb8.len() != expected {
        return Err(VerifyError::Length { found: rgb8.len(), expected, width, height });
    }
    let rgba: Vec<u8> = rgb8.chunks_exact(3).flat_map(|c| [c[0], c[1], c[2], 255]).collect();
    Ok(Picture::from_rgba8(width, height, &rgba)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene::{SceneFile, VolumeFacts};
    use spatial::{Fov, HeadGeometry, Pose};
    use volume::{Channel, ChannelKind, Voxels};

    const SIZE_PX: [u32; 2] = [48, 32];
    const CENTRE: DVec3 = DVec3::new(0.0, 1.5, -2.0);

    /// A lopsided blob of 20 cm in the room.
    fn volume() -> Volume {
        let mut voxels = Vec::new();
        for z in 0..20 {
            for y in 0..20 {
                for x in 0..20 {
                    let [x, y, z] = [x, y, z].map(|i| f64::from(i) - 9.5);
                    let at = |p: f64, q: f64, r: f64, w: f64| {
                        (-((x - p).powi(2) + (y - q).powi(2) + (z - r).powi(2)) / w).exp()
                    };
                    voxels.push((240.0 * at(0.0, 0.0, -2.0, 12.0).max(at(4.0, 1.0, 4.0, 6.0))) as u8);
                }
            }
        }
        let channel = Channel {
            name: "density".into(),
            kind: ChannelKind::Intensity,
            voxels: Voxels::U8(voxels.into()),
            slope: 1.0,
            intercept: 0.0,
        };
        Volume::new(Grid::axis_aligned([20; 3], DVec3::splat(10.0)).unwrap(), vec![channel]).unwrap()
    }

    fn scene(volume: &Volume) -> Scene {
        let json = r#"{"transfer": [[10, 0, 0, 0, 0], [240, 1, 0.8, 0.5, 0.05]], "background": [0.1, 0, 0]}"#;
        SceneFile::from_json(json).unwrap().resolve(&VolumeFacts::of(volume)).unwrap()
    }

    fn view(head: DVec3) -> StereoView {
        let geometry = HeadGeometry::parallel(0.064, Fov::symmetric(0.3, 0.2).unwrap());
        geometry.view(&Pose::looking_at(head, CENTRE, DVec3::Y).unwrap())
    }

    /// The exact picture of one view, in 8 bits.
    fn bytes(exact: &Exact<'_>, view: &StereoView) -> [Vec<u8>; 2] {
        view.eyes.map(|eye| {
            let rgba = exact.picture(eye, SIZE_PX).unwrap().to_rgba8();
            rgba.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect()
        })
    }

    #[test]
    fn the_exact_picture_in_bytes_is_half_a_step_off_at_most() {
        let volume = volume();
        let scene = scene(&volume);
        let exact = Exact::new(&volume, &scene).unwrap();
        let here = view(CENTRE + DVec3::new(0.1, 0.1, 1.2));
        let shown =
            Shown { rendered: here, seen_from: here, eye_size_px: SIZE_PX, rgb8: bytes(&exact, &here) };
        let verdict = exact.verify(&shown).unwrap();
        assert_eq!(verdict.at_rendered_pose, verdict.at_display_pose);
        assert!(verdict.at_rendered_pose.max <= 0.5 / 255.0 + 1e-12, "{verdict:?}");
        // Half a step at most everywhere is 54.2 dB at least.
        assert!(verdict.at_rendered_pose.psnr_db.unwrap() >= 54.1, "{verdict:?}");
        assert!(verdict.offset_px.unwrap() < 0.02, "{verdict:?}");
    }

    #[test]
    fn a_picture_made_for_another_place_is_noticed_by_its_offset() {
        let volume = volume();
        let scene = scene(&volume);
        let exact = Exact::new(&volume, &scene).unwrap();
        let (here, there) =
            (view(CENTRE + DVec3::new(0.1, 0.1, 1.2)), view(CENTRE + DVec3::new(0.1, 0.1, 1.2)));
        // Both eyes turned by one degree: 48 pixels are 0.3 rad wide.
        let mut turned = there;
        for eye in &mut turned.eyes {
            let turn = spatial::DQuat::from_rotation_y(1f64.to_radians());
            eye.world_from_eye.orientation = turn * eye.world_from_eye.orientation;
        }
        let expected_px = 48.0 / 2.0 / 0.15f64.tan() * 1f64.to_radians().tan();
        let rgb8 = bytes(&exact, &turned);
        let honest = Shown { rendered: turned, seen_from: here, eye_size_px: SIZE_PX, rgb8 };
        let verdict = exact.verify(&honest).unwrap();
        assert!(verdict.offset_px.unwrap() < 0.02, "{verdict:?}");
        assert!(
            (verdict.display_offset_px.unwrap() - expected_px).abs() < 0.15,
            "{verdict:?}, {expected_px}"
        );
        let lying = Shown { rendered: here, ..honest };
        let verdict = exact.verify(&lying).unwrap();
        assert!((verdict.offset_px.unwrap() - expected_px).abs() < 0.15, "{verdict:?}, {expected_px}");
        assert!(verdict.at_rendered_pose.psnr_db.unwrap() < 40.0, "{verdict:?}");
    }

    #[test]
    fn the_anchors_are_the_middle_and_the_corners() {
        let volume = volume();
        let scene = scene(&volume);
        let anchors = Exact::new(&volume, &scene).unwrap().anchors_in_world();
        assert_eq!(anchors.len(), 9);
        assert!((anchors[0] - CENTRE).length() < 1e-12);
        for corner in &anchors[1..] {
            assert!(((*corner - CENTRE).abs() - DVec3::splat(0.1)).length() < 1e-12, "{corner}");
        }
    }

    #[test]
    fn bytes_of_another_size_are_refused() {
        let volume = volume();
        let scene = scene(&volume);
        let exact = Exact::new(&volume, &scene).unwrap();
        let here = view(CENTRE + DVec3::Z);
        let shown =
            Shown { rendered: here, seen_from: here, eye_size_px: SIZE_PX, rgb8: [vec![0; 7], vec![0; 7]] };
        let error = exact.verify(&shown).unwrap_err().to_string();
        assert_eq!(error, "a decoded eye has 7 bytes, expected 4608 for 48x32 pixels");
    }
}
