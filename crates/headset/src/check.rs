//! Whether a frame is what was asked for.

use crate::motion::TraceMotion;
use codec::YuvPicture;
use session::{Device, HeadsetTime};
use spatial::{Pose, StereoView};
use std::collections::VecDeque;
use std::time::Duration;
use wire::{DepthGrid, FrameHeader};

/// How far a view may lie from where the head was and from where it came to be, before it is another pose's.
const FARTHEST_M: f64 = 0.5;
const FARTHEST_DEG: f64 = 30.0;
/// How far apart the heads may be that the two eyes of one view belong to, and their fields of view from the device's.
/// The wire carries float32.
const EYES_APART_M: f64 = 1e-3;
const EYES_APART_DEG: f64 = 0.1;
const FOV_OFF_RAD: f64 = 1e-4;
/// Before its display, a frame's view may hang on poses of this long ago: that long a jump of the trace spoils it.
const LOOKS_BACK: Duration = Duration::from_millis(150);
/// Poses that are remembered: 17 s at 60 Hz.
const MAX_SENT: usize = 1024;
/// Frames that a frame may depend on.
const MAX_DECODABLE: usize = 256;
/// Black is 16. What is visible is brighter than this somewhere; what the codec leaves of black is not.
const BRIGHTEST_BLACK: u8 = 20;
/// Cells of the depth grid, of one eye, in which something must be seen before black is wrong.
const FEWEST_CELLS: usize = 2;
/// Pixels that are looked at in a cell, along one side.
const PIXELS_A_SIDE: usize = 8;

/// A pose that was sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SentPose {
    /// Names it.
    pub sequence: u64,
    /// When the head was there.
    pub sampled_at: HeadsetTime,
    /// When its picture was expected to be shown.
    pub display_at: HeadsetTime,
    /// Where the head was.
    pub pose: Pose,
}

/// What is wrong with a frame.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Violation {
    /// The picture has another size.
    #[error("frame {frame}: picture is {found:?} pixels, expected {expected:?}")]
    Size {
        /// The frame.
        frame: u64,
        /// Width and height of both eyes together.
        found: [u32; 2],
        /// Width and height that were asked for.
        expected: [u32; 2],
    },
    /// It came after a newer one, or twice.
    #[error("frame {frame} came after frame {newest}")]
    Order {
        /// The frame.
        frame: u64,
        /// The newest one before it.
        newest: u64,
    },
    /// It hangs on a frame that was not decoded.
    #[error("frame {frame} depends on frame {depends_on}, which was not decoded")]
    Dependency {
        /// The frame.
        frame: u64,
        /// What it hangs on.
        depends_on: u64,
    },
    /// It was made for a pose that was not sent, or at other times.
    #[error(
        "frame {frame} is for pose {sequence}, sampled and shown at {found_us:?} µs, expected {expected_us:?}"
    )]
    Pose {
        /// The frame.
        frame: u64,
        /// The pose that it names.
        sequence: u64,
        /// The times of sampling and display that it names.
        found_us: [u64; 2],
        /// Those that were sent; `None` if no such pose was, of late.
        expected_us: Option<[u64; 2]>,
    },
    /// Its view is far from its pose, and from where the head was at the display time.
    #[error(
        "frame {frame}: view is {position_m:.3} m and {angle_deg:.1}° from where the head is, expected at most \
         {FARTHEST_M} m and {FARTHEST_DEG}°"
    )]
    View {
        /// The frame.
        frame: u64,
        /// Metres from the true pose at display time.
        position_m: f64,
        /// Degrees from it.
        angle_deg: f64,
    },
    /// Its eyes are not this headset's eyes.
    #[error("frame {frame}: the eyes or fields of view are not this headset's")]
    Eyes {
        /// The frame.
        frame: u64,
    },
    /// The picture is black where the depth grid says that something is seen.
    #[error(
        "frame {frame}: {} eye is black (luma at most {brightest}) in all of {cells} cells where something is seen",
        if *eye == 0 { "left" } else { "right" }
    )]
    Black {
        /// The frame.
        frame: u64,
        /// 0 left, 1 right.
        eye: usize,
        /// Cells of the depth grid with something in them.
        cells: usize,
        /// The highest luma found there.
        brightest: u8,
    },
    /// The access unit did not decode, although all that it hangs on did.
    #[error("frame {frame} did not decode: {error}")]
    Undecodable {
        /// The frame.
        frame: u64,
        /// What the decoder said.
        error: codec::DecodeError,
    },
}

impl Violation {
    /// Its kind, for counts: lower case.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Size { .. } => "size",
            Self::Order { .. } => "order",
            Self::Dependency { .. } => "dependency",
            Self::Pose { .. } => "pose",
            Self::View { .. } => "view",
            Self::Eyes { .. } => "eyes",
            Self::Black { .. } => "black",
            Self::Undecodable { .. } => "undecodable",
        }
    }
}

/// How far the view of a frame is from where the head truly was when it was to be shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PredictionError {
    /// Millimetres.
    pub position_mm: f64,
    /// Degrees.
    pub angle_deg: f64,
}

/// What a look at a frame found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameFindings {
    /// What is wrong with it.
    pub violations: Vec<Violation>,
    /// `None` if the pose was not sent, or the trace jumps so near that nobody could foresee it.
    pub prediction_error: Option<PredictionError>,
    /// Whether the trace jumps so near that the view was not judged.
    pub crosses_jump: bool,
    /// Whether the frame says where something is seen. Without that, a black picture is as good as any.
    pub has_depth: bool,
}

/// Checks the frames of one headset, in the order in which they are decoded.
#[derive(Debug)]
pub struct Checker {
    device: Device,
    sent: VecDeque<SentPose>,
    newest: Option<u64>,
    decodable: VecDeque<u64>,
}

impl Checker {
    /// For a headset that told the server to be `device`.
    #[must_use]
    pub fn new(device: Device) -> Self {
        Self { device, sent: VecDeque::new(), newest: None, decodable: VecDeque::new() }
    }

    /// Remembers a pose that was sent.
    pub fn pose_sent(&mut self, sent: SentPose) {
        if self.sent.len() == MAX_SENT {
            self.sent.pop_front();
        }
        self.sent.push_back(sent);
    }

    /// Looks at a frame that was decoded. `truth` is where the head is at any time.
    pub fn check(
        &mut self,
        header: &FrameHeader,
        view: &StereoView,
        picture: &YuvPicture,
        truth: &TraceMotion,
    ) -> FrameFindings {
        let mut findings = FrameFindings::default();
        self.check_order(header, &mut findings.violations);
        self.check_size(header.frame, picture, &mut findings.violations);
        self.check_view(header, view, truth, &mut findings);
        findings.has_depth = header.depth.columns > 0 && header.depth.rows > 0;
        for eye in 0..2 {
            findings.violations.extend(black(header.frame, eye, &header.depth, picture));
        }
        findings
    }

    fn check_order(&mut self, header: &FrameHeader, violations: &mut Vec<Violation>) {
        let frame = header.frame;
        if let Some(newest) = self.newest.filter(|newest| frame <= *newest) {
            violations.push(Violation::Order { frame, newest });
        }
        match header.depends_on {
            None => self.decodable.clear(),
            Some(depends_on) if !self.decodable.contains(&depends_on) => {
                violations.push(Violation::Dependency { frame, depends_on });
            }
            Some(_) => {}
        }
        if self.decodable.len() == MAX_DECODABLE {
            self.decodable.pop_front();
        }
        self.decodable.push_back(frame);
        self.newest = self.newest.max(Some(frame));
    }

    fn check_size(&self, frame: u64, picture: &YuvPicture, violations: &mut Vec<Violation>) {
        let layout = picture.layout();
        let found = [layout.width_px(), layout.height_px()];
        let expected = [2 * self.device.eye_width_px, self.device.eye_height_px];
        if found != expected {
            violations.push(Violation::Size { frame, found, expected });
        }
    }

    fn check_view(
        &self,
        header: &FrameHeader,
        view: &StereoView,
        truth: &TraceMotion,
        findings: &mut FrameFindings,
    ) {
        let frame = header.frame;
        let sent = self.sent.iter().rev().find(|sent| sent.sequence == header.pose_sequence);
        let found_us = [header.pose_sampled_at_us, header.display_at_us];
        let expected_us = sent.map(|sent| [sent.sampled_at.as_micros(), sent.display_at.as_micros()]);
        let Some(sent) = sent.filter(|_| expected_us == Some(found_us)) else {
            let sequence = header.pose_sequence;
            findings.violations.push(Violation::Pose { frame, sequence, found_us, expected_us });
            return;
        };

        let geometry = &self.device.geometry;
        let [left, right] =
            [0, 1].map(|i| view.eyes[i].world_from_eye.then(&inverse(&geometry.head_from_eye[i])));
        let fov_off = |i: usize| {
            let (found, expected) = (view.eyes[i].fov, geometry.fov[i]);
            [
                found.left - expected.left,
                found.right - expected.right,
                found.up - expected.up,
                found.down - expected.down,
            ]
            .iter()
            .any(|off| off.abs() > FOV_OFF_RAD)
        };
        let apart = distance(&left, &right);
        if apart.0 > EYES_APART_M || apart.1 > EYES_APART_DEG || fov_off(0) || fov_off(1) {
            findings.violations.push(Violation::Eyes { frame });
        }

        findings.crosses_jump = truth.jumps_between(sent.sampled_at - LOOKS_BACK, sent.display_at);
        if findings.crosses_jump {
            return;
        }
        let (position_m, angle_deg) = distance(&left, &truth.at(sent.display_at));
        findings.prediction_error = Some(PredictionError { position_mm: 1e3 * position_m, angle_deg });
        let is_near = |(position_m, angle_deg)| position_m <= FARTHEST_M && angle_deg <= FARTHEST_DEG;
        // A slow server foresees only so much of the way: then the view still is near the pose it was made for.
        if !is_near((position_m, angle_deg)) && !is_near(distance(&left, &sent.pose)) {
            findings.violations.push(Violation::View { frame, position_m, angle_deg });
        }
    }
}

/// Metres and degrees from one pose to another.
fn distance(a: &Pose, b: &Pose) -> (f64, f64) {
    ((a.position_m - b.position_m).length(), a.angle_to(b).to_degrees())
}

fn inverse(pose: &Pose) -> Pose {
    let orientation = pose.orientation.conjugate();
    Pose { position_m: -(orientation * pose.position_m), orientation }
}

/// The violation, if an eye's picture is black in every cell in which the grid says that something is seen.
fn black(frame: u64, eye: usize, depth: &DepthGrid, picture: &YuvPicture) -> Option<Violation> {
    let (columns, rows) = (usize::from(depth.columns), usize::from(depth.rows));
    let distances = depth.distances_mm.get(eye * columns * rows..)?;
    let layout = picture.layout();
    let (width, height) = (layout.width_px() as usize / 2, layout.height_px() as usize);
    let luma = picture.as_frame().y();
    let mut cells = 0;
    let mut brightest = 0;
    for (row, distances) in distances.chunks(columns.max(1)).take(rows).enumerate() {
        for (column, _) in distances.iter().enumerate().filter(|(_, distance)| **distance > 0) {
            cells += 1;
            let xs = column * width / columns..((column + 1) * width).div_ceil(columns);
            let ys = row * height / rows..((row + 1) * height).div_ceil(rows);
            for y in ys.clone().step_by(ys.len().div_ceil(PIXELS_A_SIDE).max(1)) {
                let line = &luma[y * layout.y_stride() + eye * width..][..width];
                let step = xs.len().div_ceil(PIXELS_A_SIDE).max(1);
                let found = line[xs.clone()].iter().step_by(step).copied().max();
                brightest = brightest.max(found.unwrap_or(0));
            }
            if brightest > BRIGHTEST_BLACK {
                return None;
            }
        }
    }
    (cells >= FEWEST_CELLS).then_some(Violation::Black { frame, eye, cells, brightest })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DeviceModel;
    use codec::PlaneLayout;
    use spatial::{DQuat, DVec3};
    use std::sync::Arc;
    use trace::{Ending, Trace};

    const BEGAN: HeadsetTime = HeadsetTime::from_micros(1_000_000);

    /// A head that walks to the right at 1 m/s for ever.
    fn walk() -> TraceMotion {
        let text = "0 0 1.6 0 0 0 0 1\n100 100 1.6 0 0 0 0 1\n";
        let trace = Trace::parse("walk", text.as_bytes()).unwrap();
        TraceMotion::new(Arc::new(trace), Ending::Hold, BEGAN, 0.0)
    }

    struct Frame {
        header: FrameHeader,
        view: StereoView,
        picture: YuvPicture,
    }

    fn device() -> Device {
        DeviceModel::Pixels { width: 64, height: 32 }.device(60.0).unwrap()
    }

    /// A frame as it should be: for pose 7, half a second after the beginning, shown 50 ms later, with something in
    /// the upper left of both eyes.
    fn frame() -> Frame {
        let truth = walk();
        let sampled_at = BEGAN + Duration::from_millis(500);
        let display_at = sampled_at + Duration::from_millis(50);
        let mut rgb = vec![0; 3 * 128 * 32];
        for eye in 0..2 {
            rgb[3 * (64 * eye + 128 * 3 + 4)] = 200;
            rgb[3 * (64 * eye + 128 * 3 + 4) + 1] = 200;
        }
        let view = device().geometry.view(&truth.at(display_at));
        let mut distances_mm = vec![0; 2 * 8 * 4];
        for eye in 0..2 {
            distances_mm[32 * eye..][..2].fill(2000);
        }
        let header = FrameHeader {
            frame: 3,
            depends_on: None,
            scene_revision: 0,
            time_step: 0,
            pose_sequence: 7,
            pose_sampled_at_us: sampled_at.as_micros(),
            display_at_us: display_at.as_micros(),
            eyes: [wire::EyeView {
                world_from_eye: wire::Pose { position_m: [0.0; 3], orientation_xyzw: [0.0, 0.0, 0.0, 1.0] },
                fov: wire::Fov { left_rad: -0.1, right_rad: 0.1, up_rad: 0.1, down_rad: -0.1 },
            }; 2],
            stages: wire::StageTimes::default(),
            quality: wire::Quality::default(),
            depth: DepthGrid { columns: 8, rows: 4, distances_mm },
            access_unit_bytes: 0,
        };
        Frame { header, view, picture: YuvPicture::from_rgb8(128, 32, &rgb).unwrap() }
    }

    fn checker() -> Checker {
        let mut checker = Checker::new(device());
        let frame = frame();
        let sampled_at = HeadsetTime::from_micros(frame.header.pose_sampled_at_us);
        checker.pose_sent(SentPose {
            sequence: 7,
            sampled_at,
            display_at: HeadsetTime::from_micros(frame.header.display_at_us),
            pose: walk().at(sampled_at),
        });
        checker
    }

    fn findings(checker: &mut Checker, spoil: impl FnOnce(&mut Frame)) -> FrameFindings {
        let mut frame = frame();
        spoil(&mut frame);
        checker.check(&frame.header, &frame.view, &frame.picture, &walk())
    }

    #[track_caller]
    fn check(spoil: impl FnOnce(&mut Frame), expected: &[&str]) {
        let findings = findings(&mut checker(), spoil);
        let kinds: Vec<_> = findings.violations.iter().map(Violation::kind).collect();
        assert_eq!(kinds, expected, "{:?}", findings.violations);
    }

    #[test]
    fn a_frame_as_it_should_be_passes() {
        let findings = findings(&mut checker(), |_| {});
        assert_eq!(findings.violations, []);
        let error = findings.prediction_error.unwrap();
        assert!(error.position_mm < 1e-6 && error.angle_deg < 1e-6, "{error:?}");
        assert!(findings.has_depth && !findings.crosses_jump);
    }

    #[test]
    fn a_frame_without_prediction_is_off_by_the_way_walked_meanwhile() {
        let findings = findings(&mut checker(), |frame| {
            let sampled_at = HeadsetTime::from_micros(frame.header.pose_sampled_at_us);
            frame.view = device().geometry.view(&walk().at(sampled_at));
        });
        assert_eq!(findings.violations, []);
        assert!((findings.prediction_error.unwrap().position_mm - 50.0).abs() < 1e-6);
    }

    #[test]
    fn each_lie_has_its_name() {
        check(|frame| frame.picture = YuvPicture::from_rgb8(64, 32, &[200; 3 * 64 * 32]).unwrap(), &["size"]);
        check(|frame| frame.header.depends_on = Some(2), &["dependency"]);
        check(|frame| frame.header.pose_sequence = 8, &["pose"]);
        check(|frame| frame.header.pose_sampled_at_us += 1, &["pose"]);
        check(|frame| frame.header.display_at_us -= 1, &["pose"]);
        check(
            |frame| frame.view.eyes.iter_mut().for_each(|e| e.world_from_eye.position_m += DVec3::Z),
            &["view"],
        );
        let turned = Pose { orientation: DQuat::from_rotation_y(1.0), ..walk().at(BEGAN) };
        check(|frame| frame.view = device().geometry.view(&turned), &["view"]);
        check(|frame| frame.view.eyes.swap(0, 1), &["eyes"]);
        check(|frame| frame.view.eyes[1].fov.up += 0.01, &["eyes"]);
        check(
            |frame| frame.picture = YuvPicture::black(PlaneLayout::packed(128, 32).unwrap()),
            &["black", "black"],
        );
    }

    #[test]
    fn black_is_right_where_nothing_is_seen() {
        let black = |frame: &mut Frame| {
            frame.picture = YuvPicture::black(PlaneLayout::packed(128, 32).unwrap());
        };
        check(
            |frame| {
                black(frame);
                frame.header.depth.distances_mm.fill(0);
            },
            &[],
        );
        check(
            |frame| {
                black(frame);
                frame.header.depth = DepthGrid::default();
            },
            &[],
        );
        // Something is seen, but elsewhere than the picture shows it.
        check(
            |frame| {
                frame.header.depth.distances_mm.fill(0);
                frame.header.depth.distances_mm[30..32].fill(1000);
            },
            &["black"],
        );
    }

    #[test]
    fn frames_come_in_order_and_hang_together() {
        let mut checker = checker();
        let mut kinds = |frame: u64, depends_on: Option<u64>| {
            let findings = findings(&mut checker, |f| {
                (f.header.frame, f.header.depends_on) = (frame, depends_on);
            });
            findings.violations.iter().map(Violation::kind).collect::<Vec<_>>()
        };
        assert!(kinds(1, None).is_empty());
        assert!(kinds(2, Some(1)).is_empty());
        assert!(kinds(9, Some(1)).is_empty(), "gaps, and any earlier frame");
        assert_eq!(kinds(9, Some(2)), ["order"]);
        assert!(kinds(10, None).is_empty());
        assert_eq!(kinds(11, Some(9)), ["dependency"], "nothing hangs on what was before a key frame");
    }

    #[test]
    fn a_jump_of_the_trace_is_nobody_s_fault() {
        let text = "0 0 1.6 0 0 0 0 1\n0.5 0 1.6 0 0 0 0 1\n0.501 9 1.6 0 0 0 0 1\n";
        let trace = Arc::new(Trace::parse("jump", text.as_bytes()).unwrap());
        let truth = TraceMotion::new(trace, Ending::Hold, BEGAN, 0.0);
        let frame = frame();
        let findings = checker().check(&frame.header, &frame.view, &frame.picture, &truth);
        assert_eq!(findings.violations, []);
        assert!(findings.crosses_jump && findings.prediction_error.is_none());
    }
}
