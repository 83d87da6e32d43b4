//! Where the time between a pose and its picture went.

use crate::time::{ClockOffset, HeadsetTime, ServerTime};

/// One stretch of a frame's way, in the order in which they follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// From the pose's time to its arrival at the server.
    Uplink,
    /// From there until the renderer begins: waiting for the GPU, and for a newer pose that did not come.
    Wait,
    /// The renderer.
    Render,
    /// Conversion to YUV and the way back from the GPU.
    ReadBack,
    /// Waiting for the encoder.
    EncodeWait,
    /// The encoder.
    Encode,
    /// From the encoder's end until the frame is handed to the network: the way from one thread to another.
    Send,
    /// From the network's hand to the last byte's arrival at the headset.
    Network,
    /// Waiting for the decoder.
    DecodeWait,
    /// The decoder.
    Decode,
}

impl Stage {
    /// All stages in order.
    pub const ALL: [Self; 10] = [
        Self::Uplink,
        Self::Wait,
        Self::Render,
        Self::ReadBack,
        Self::EncodeWait,
        Self::Encode,
        Self::Send,
        Self::Network,
        Self::DecodeWait,
        Self::Decode,
    ];

    /// The stage's name for reports: lower case, words joined by `_`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Uplink => "uplink",
            Self::Wait => "wait",
            Self::Render => "render",
            Self::ReadBack => "read_back",
            Self::EncodeWait => "encode_wait",
            Self::Encode => "encode",
            Self::Send => "send",
            Self::Network => "network",
            Self::DecodeWait => "decode_wait",
            Self::Decode => "decode",
        }
    }
}

/// The boundaries of all stages of one frame, on the headset's clock. Stages share their boundaries, so their sum is
/// exactly the time from pose to decoded picture. A stage that crosses from one clock to the other ([`Stage::Uplink`],
/// [`Stage::Network`]) carries the error of the clock offset, one with plus and the other with minus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameTimeline {
    /// The frame.
    pub frame: u64,
    /// The pose it was made for.
    pub pose_sequence: u64,
    /// When its picture was expected to be shown.
    pub display_at: HeadsetTime,
    /// How wrong the clock offset may be, in microseconds.
    pub clock_error_us: u64,
    boundaries: [HeadsetTime; Stage::ALL.len() + 1],
}

/// What the headset knows of a frame's way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Arrival {
    pub(crate) completed_at: HeadsetTime,
    pub(crate) decode_started_at: HeadsetTime,
    pub(crate) decoded_at: HeadsetTime,
}

/// Times beyond this come from a broken peer; below it, differences and their sums fit 64 bits.
const LATEST: HeadsetTime = HeadsetTime::from_micros(1 << 60);

impl FrameTimeline {
    pub(crate) fn new(header: &wire::FrameHeader, arrival: &Arrival, clock: ClockOffset) -> Self {
        let wire::StageTimes {
            pose_received_us,
            render_started_us,
            rendered_us,
            converted_us,
            encode_started_us,
            encoded_us,
            sent_us,
        } = header.stages;
        let at_server = |micros: u64| clock.to_headset(ServerTime::from_micros(micros));
        let boundaries = [
            HeadsetTime::from_micros(header.pose_sampled_at_us),
            at_server(pose_received_us),
            at_server(render_started_us),
            at_server(rendered_us),
            at_server(converted_us),
            at_server(encode_started_us),
            at_server(encoded_us),
            at_server(sent_us),
            arrival.completed_at,
            arrival.decode_started_at,
            arrival.decoded_at,
        ]
        .map(|time| time.min(LATEST));
        Self {
            frame: header.frame,
            pose_sequence: header.pose_sequence,
            display_at: HeadsetTime::from_micros(header.display_at_us),
            clock_error_us: clock.error_us,
            boundaries,
        }
    }

    /// When the pose was taken.
    #[must_use]
    pub fn pose_sampled_at(&self) -> HeadsetTime {
        self.boundaries[0]
    }

    /// When the picture was decoded.
    #[must_use]
    pub fn decoded_at(&self) -> HeadsetTime {
        self.boundaries[Stage::ALL.len()]
    }

    /// How long a stage took, in microseconds. Negative only for the two stages that cross clocks, by no more than the
    /// clock's error, unless the server's times are wrong.
    #[must_use]
    pub fn micros(&self, stage: Stage) -> i64 {
        let index = stage as usize;
        self.boundaries[index + 1].micros_since(self.boundaries[index])
    }

    /// Every stage with how long it took, in microseconds.
    #[must_use]
    pub fn stages(&self) -> [(Stage, i64); Stage::ALL.len()] {
        Stage::ALL.map(|stage| (stage, self.micros(stage)))
    }

    /// From pose to decoded picture, in microseconds: the sum of all stages.
    #[must_use]
    pub fn pose_to_decoded_us(&self) -> i64 {
        self.decoded_at().micros_since(self.pose_sampled_at())
    }

    /// The age of the pose when the renderer began, in microseconds.
    #[must_use]
    pub fn pose_age_at_render_us(&self) -> i64 {
        self.micros(Stage::Uplink) + self.micros(Stage::Wait)
    }

    /// How long after its expected display time the picture was decoded, in microseconds; negative if before.
    #[must_use]
    pub fn lateness_us(&self) -> i64 {
        self.decoded_at().micros_since(self.display_at.min(LATEST))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn header(pose_sampled_at_us: u64, stages: [u64; 7]) -> wire::FrameHeader {
        let pose = wire::Pose { position_m: [0.0; 3], orientation_xyzw: [0.0, 0.0, 0.0, 1.0] };
        let fov = wire::Fov { left_rad: -0.2, right_rad: 0.2, up_rad: 0.2, down_rad: -0.2 };
        let eye = wire::EyeView { world_from_eye: pose, fov };
        wire::FrameHeader {
            frame: 5,
            depends_on: Some(4),
            scene_revision: 0,
            time_step: 0,
            pose_sequence: 9,
            pose_sampled_at_us,
            display_at_us: pose_sampled_at_us.saturating_add(50_000),
            eyes: [eye, eye],
            stages: wire::StageTimes {
                pose_received_us: stages[0],
                render_started_us: stages[1],
                rendered_us: stages[2],
                converted_us: stages[3],
                encode_started_us: stages[4],
                encoded_us: stages[5],
                sent_us: stages[6],
            },
            quality: wire::Quality::default(),
            depth: wire::DepthGrid::default(),
            access_unit_bytes: 0,
        }
    }

    #[test]
    fn stages_are_told_apart_across_two_clocks() {
        // The server's clock is a second ahead of the headset's.
        let clock = ClockOffset { server_minus_headset_us: 1_000_000, error_us: 40 };
        let header =
            header(5_000_000, [6_001_000, 6_003_000, 6_011_000, 6_014_000, 6_014_500, 6_020_500, 6_020_600]);
        let arrival = Arrival {
            completed_at: HeadsetTime::from_micros(5_024_000),
            decode_started_at: HeadsetTime::from_micros(5_024_100),
            decoded_at: HeadsetTime::from_micros(5_027_100),
        };
        let timeline = FrameTimeline::new(&header, &arrival, clock);
        let micros: Vec<i64> = timeline.stages().iter().map(|(_, micros)| *micros).collect();
        assert_eq!(micros, [1_000, 2_000, 8_000, 3_000, 500, 6_000, 100, 3_400, 100, 3_000]);
        assert_eq!(timeline.pose_to_decoded_us(), 27_100);
        assert_eq!(timeline.pose_age_at_render_us(), 3_000);
        assert_eq!(timeline.lateness_us(), -22_900);
    }

    proptest! {
        #[test]
        fn stages_sum_to_the_whole_whatever_the_times(
            sampled in any::<u64>(), stages in any::<[u64; 7]>(), arrival in any::<[u64; 3]>(), offset in any::<i64>(),
        ) {
            let [completed_at, decode_started_at, decoded_at] = arrival.map(HeadsetTime::from_micros);
            let timeline = FrameTimeline::new(
                &header(sampled, stages),
                &Arrival { completed_at, decode_started_at, decoded_at },
                ClockOffset { server_minus_headset_us: offset, error_us: 0 },
            );
            let sum: i64 = timeline.stages().iter().map(|(_, micros)| micros).sum();
            prop_assert_eq!(sum, timeline.pose_to_decoded_us());
        }
    }
}
