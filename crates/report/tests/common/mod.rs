//! Runs that never were: seeded, so that they are the same everywhere.

use report::{
    Clock, Counters, FrameRecord, HeadsetRun, Machine, PictureError, Process, Run, Server, StageNames,
    Verification, VerifiedFrame, Volume,
};

/// The stages of a frame as the sessions name them.
pub(crate) const STAGES: [&str; 10] = [
    "uplink",
    "wait",
    "render",
    "read_back",
    "encode_wait",
    "encode",
    "send",
    "network",
    "decode_wait",
    "decode",
];

/// Mean microseconds of each stage.
const MEANS_US: [f64; 10] =
    [900.0, 2_500.0, 9_000.0, 1_800.0, 500.0, 4_500.0, 150.0, 1_600.0, 350.0, 2_400.0];

/// Numbers that look like chance: splitmix64.
pub(crate) struct Chance(u64);

impl Chance {
    pub(crate) fn seeded(seed: u64) -> Self {
        Self(seed)
    }

    /// Evenly in 0 to 1.
    pub(crate) fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// A headset that asks for 60 frames a second, with a hump of load, a freeze, lost frames and a few outliers.
pub(crate) fn headset(name: &str, seed: u64, seconds: f64) -> HeadsetRun {
    let mut chance = Chance::seeded(seed);
    let mut headset = HeadsetRun {
        name: name.to_owned(),
        device: "hololens1".to_owned(),
        eye_size_px: [1268, 720],
        trace: "circle.csv".to_owned(),
        started_at_secs: 0.1,
        seconds,
        asked_hz: 60.0,
        full_step_scale: 0.5,
        clock: Some(Clock { server_minus_headset_us: -1_234_567, error_us: 120 }),
        ..HeadsetRun::default()
    };
    let mut decoded_at_before = 0.0;
    for frame in 0..(seconds * 60.0) as u64 {
        let share = frame as f64 / (seconds * 60.0);
        let frozen = (0.62..0.66).contains(&share);
        if frozen || chance.share() < 0.004 {
            headset.counters.lost += 1;
            continue;
        }
        let load = 1.0 + 0.9 * (-((share - 0.4) / 0.1).powi(2)).exp();
        let resolution_scale = if (0.38..0.55).contains(&share) { 0.75 } else { 1.0 };
        let step_scale = if (0.34..0.6).contains(&share) { 0.75 } else { 0.5 };
        let outlier = if chance.share() < 0.004 { 4.0 } else { 1.0 };
        let stages_us: Vec<i64> = MEANS_US
            .iter()
            .enumerate()
            .map(|(stage, mean)| {
                let spread = 0.7 + 0.6 * chance.share();
                let heavy = if stage == 2 { load * resolution_scale * outlier } else { 1.0 };
                (mean * spread * heavy) as i64
            })
            .collect();
        let pose_to_decoded_us: i64 = stages_us.iter().sum();
        let key_frame = frame.is_multiple_of(240);
        let pose_at_secs = 0.1 + frame as f64 / 60.0;
        decoded_at_before = (pose_at_secs + pose_to_decoded_us as f64 * 1e-6).max(decoded_at_before);
        let lateness_us = pose_to_decoded_us - 33_333;
        headset.counters.late += u64::from(lateness_us > 0);
        headset.frames.push(FrameRecord {
            frame,
            decoded_at_secs: decoded_at_before,
            pose_age_at_render_us: stages_us[0] + stages_us[1],
            stages_us,
            clock_error_us: 120,
            pose_to_decoded_us,
            lateness_us,
            bytes: if key_frame { 42_000 } else { 9_000 + (4_000.0 * chance.share()) as u64 },
            key_frame,
            resolution_scale,
            step_scale,
            prediction_error_mm: Some(2.0 * chance.share()),
            prediction_error_deg: Some(0.4 * chance.share()).filter(|_| frame % 2 == 0),
            pose_to_shown_us: pose_to_decoded_us.max(33_333),
            head_deg_per_sec: Some(80.0 * share),
            // What a head that turns so fast is off by without prediction.
            registration_px: Some(80.0 * share * pose_to_decoded_us.max(33_333) as f64 * 4e-5),
            registration_deg: Some(80.0 * share * pose_to_decoded_us.max(33_333) as f64 * 1e-6),
        });
    }
    let decoded = headset.frames.len() as u64;
    headset.counters = Counters {
        rendered: Some(decoded + headset.counters.lost),
        sent: Some(decoded + headset.counters.lost),
        reset: Some(headset.counters.lost),
        skipped: Some(0),
        received: decoded,
        decoded,
        ..headset.counters
    };
    headset.verification = Some(Verification {
        frames: (0..3).map(|index| verified(10 * index)).collect(),
        skipped: 1,
        notes: Vec::new(),
    });
    headset
}

/// A picture of which little was lost, but that was seen from elsewhere.
fn verified(frame: u64) -> VerifiedFrame {
    let error = |psnr_db: f64| PictureError {
        psnr_db: Some(psnr_db),
        rmse: 10f64.powf(-psnr_db / 20.0),
        max_error: 10f64.powf(-psnr_db / 40.0),
    };
    VerifiedFrame {
        frame,
        time_step: 0,
        at_rendered_pose: error(40.0 + 0.1 * frame as f64),
        at_display_pose: error(30.0 - 0.2 * frame as f64),
        offset_px: Some(0.05),
        display_offset_px: Some(4.0 + 0.1 * frame as f64),
        age_ms: Some(30.0 + frame as f64),
        head_deg_per_sec: Some(5.0 * frame as f64),
        registration_px: Some(4.1 + 0.1 * frame as f64),
        registration_deg: Some(0.1 + 0.0025 * frame as f64),
    }
}

/// A run of headsets that each ran for so many seconds.
pub(crate) fn run(headsets: u64, seconds: f64) -> Run {
    let names = ["desk", "door", "window", "table", "wall", "lamp"];
    let name = |index: u64| format!("{}-{}", names[(index % 6) as usize], index + 1);
    let headsets = (0..headsets).map(|index| headset(&name(index), 7 + index, seconds));
    Run {
        title: "holocast demo".to_owned(),
        started_at: "2026-03-01T09:30:00Z".to_owned(),
        seconds: seconds + 0.4,
        versions: [("holocast".to_owned(), "0.1.0".to_owned())].into(),
        machine: Machine {
            os: "Debian GNU/Linux 12".to_owned(),
            cpu: Some("a processor".to_owned()),
            cores: 2,
            memory_bytes: Some(8_000_000_000),
            adapter: None,
        },
        server: Some(Server {
            name: "box".to_owned(),
            address: "127.0.0.1:4433".to_owned(),
            protocol: "holocast/1".to_owned(),
            codec: Some("avc1.42C020".to_owned()),
            adapter: Some("llvmpipe".to_owned()),
            volume: Some(Volume {
                name: "head.nii.gz".to_owned(),
                dimensions: [256, 256, 180],
                spacing_mm: Some([0.9, 0.9, 1.2]),
            }),
        }),
        processes: vec![Process {
            name: "server".to_owned(),
            cpu_secs: Some(seconds * 1.4),
            rss_bytes: Some(180_000_000),
            rss_peak_bytes: Some(201_000_000),
        }],
        stages: StageNames::new(STAGES),
        headsets: headsets.collect(),
    }
}
