//! How far what is shown is from where it should be seen.

use crate::run::SampledFrame;
use codec::YuvPicture;
use session::ReceivedFrame;
use spatial::{DVec3, Displacement, StereoView, displacement};

/// How far anchors seem to be from where they are when a picture made for `rendered` is shown, as it is, to eyes at `shown`:
/// the mean over all that are seen and both eyes. `None` if none is seen.
pub(crate) fn registration(
    rendered: &StereoView,
    shown: &StereoView,
    anchors_in_world: &[DVec3],
    eye_size_px: [u32; 2],
) -> Option<Displacement> {
    let eyes = || rendered.eyes.iter().zip(&shown.eyes);
    let found: Vec<Displacement> = anchors_in_world
        .iter()
        .flat_map(|anchor| eyes().filter_map(|(from, to)| displacement(from, to, *anchor, eye_size_px)))
        .collect();
    #[expect(clippy::cast_precision_loss, reason = "a count of anchors")]
    let mean = |of: fn(&Displacement) -> f64| found.iter().map(of).sum::<f64>() / found.len() as f64;
    (!found.is_empty()).then(|| Displacement { angle_deg: mean(|d| d.angle_deg), px: mean(|d| d.px) })
}

/// A picture put aside as it came, so that the run is not held up; its colours are made when the run is over.
pub(crate) struct Aside {
    frame: u64,
    scene_revision: u32,
    time_step: u32,
    rendered: StereoView,
    seen_from: StereoView,
    picture: YuvPicture,
}

impl Aside {
    pub(crate) fn new(received: &ReceivedFrame, seen_from: StereoView, picture: YuvPicture) -> Self {
        let header = &received.header;
        Self {
            frame: header.frame,
            scene_revision: header.scene_revision,
            time_step: header.time_step,
            rendered: received.view,
            seen_from,
            picture,
        }
    }

    pub(crate) fn sampled(&self) -> SampledFrame {
        let layout = self.picture.layout();
        let eye_size_px = [layout.width_px() / 2, layout.height_px()];
        let rgb = self.picture.to_rgb8();
        let half = 3 * eye_size_px[0] as usize;
        let eye = |eye: usize| {
            rgb.chunks_exact(2 * half).flat_map(|row| &row[eye * half..][..half]).copied().collect()
        };
        SampledFrame {
            frame: self.frame,
            scene_revision: self.scene_revision,
            time_step: self.time_step,
            rendered: self.rendered,
            seen_from: self.seen_from,
            eye_size_px,
            rgb8: [eye(0), eye(1)],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spatial::{DQuat, Fov, HeadGeometry, Pose};

    #[test]
    fn registration_is_the_mean_over_what_is_seen() {
        let geometry = HeadGeometry::parallel(0.064, Fov::symmetric(0.5, 0.3).unwrap());
        let shown = geometry.view(&Pose::IDENTITY);
        let turned = Pose { orientation: DQuat::from_rotation_y(0.02), ..Pose::IDENTITY };
        let ahead = [DVec3::new(0.0, 0.0, -2.0), DVec3::new(0.1, 0.05, -2.5), DVec3::new(0.0, 0.0, 2.0)];
        let found = registration(&geometry.view(&turned), &shown, &ahead, [320, 180]).unwrap();
        // Eyes 32 mm from the axis of the turn move by less than a millimetre: 0.02 degrees at 2 m.
        assert!((found.angle_deg - 0.02f64.to_degrees()).abs() < 0.03, "{found:?}");
        assert!((found.px - 160.0 / 0.25f64.tan() * 0.02).abs() < 0.4, "{found:?}");
        assert_eq!(registration(&shown, &shown, &ahead[2..], [320, 180]), None, "behind");
        assert_eq!(registration(&shown, &shown, &[], [320, 180]), None);
    }

    #[test]
    fn a_picture_put_aside_is_cut_into_its_eyes() {
        let rgb: Vec<u8> = (0..4).flat_map(|_| [[0u8; 3], [0; 3], [255; 3], [255; 3]].concat()).collect();
        let geometry = HeadGeometry::parallel(0.064, Fov::symmetric(0.5, 0.3).unwrap());
        let view = geometry.view(&Pose::IDENTITY);
        let aside = Aside {
            frame: 7,
            scene_revision: 1,
            time_step: 0,
            rendered: view,
            seen_from: view,
            picture: YuvPicture::from_rgb8(4, 4, &rgb).unwrap(),
        };
        let sampled = aside.sampled();
        assert_eq!(sampled.eye_size_px, [2, 4]);
        assert_eq!(sampled.rgb8, [vec![0; 24], vec![255; 24]]);
    }
}
