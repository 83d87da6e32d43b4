//! Recordings are read back with the MP4 reader and decoded with the decoder.

use codec::{AccessUnit, Complexity, Decoder, Encoder, EncoderSettings, PlaneLayout, YuvPicture};
use mp4_atom::{Avc1, Codec, Decode, Ftyp, Header, Moov, Stbl, StszSamples};
use recording::{Recording, RecordingError};
use std::path::Path;
use std::time::Duration;

fn encoder(width_px: u32, height_px: u32) -> Encoder {
    let (frames_per_second, bitrate_bps) = (60.0, 2_000_000);
    let complexity = Complexity::Low;
    Encoder::new(EncoderSettings { width_px, height_px, frames_per_second, bitrate_bps, complexity })
        .expect("the settings are in range")
}

/// A picture that gets lighter from left to right, and from frame to frame.
fn picture(width_px: u32, height_px: u32, frame: u32) -> YuvPicture {
    let layout = PlaneLayout::packed(width_px, height_px).expect("the sides are even");
    let mut bytes = YuvPicture::black(layout).into_bytes();
    for (i, y) in bytes[layout.y_range()].iter_mut().enumerate() {
        *y = (16 + (i % layout.y_stride()) as u32 * 150 / width_px + 2 * (frame % 30)) as u8;
    }
    YuvPicture::new(layout, bytes).expect("the buffer is the layout's")
}

/// What a player would do: find each sample by the index, and decode it.
struct Player {
    file: Vec<u8>,
    stbl: Stbl,
    window: (u16, u16),
    duration_ticks: u64,
}

impl Player {
    fn open(path: &Path) -> Self {
        let file = std::fs::read(path).expect("the recording is there");
        let mut rest = &file[..];
        Ftyp::decode(&mut rest).expect("begins with its type");
        let media = Header::decode(&mut rest).expect("then the media data");
        rest = &rest[media.size.expect("with a size")..];
        let moov = Moov::decode(&mut rest).expect("then the index");
        assert!(rest.is_empty(), "{} bytes behind the index", rest.len());
        let track = moov.trak.into_iter().next().expect("with a track");
        let window = (track.tkhd.width.integer(), track.tkhd.height.integer());
        Self { file, stbl: track.mdia.minf.stbl, window, duration_ticks: track.mdia.mdhd.duration }
    }

    /// Each sample's description and bytes.
    fn samples(&self) -> Vec<(&Avc1, &[u8])> {
        let StszSamples::Different { sizes } = &self.stbl.stsz.samples else {
            panic!("samples of equal size")
        };
        let offsets = &self.stbl.co64.as_ref().expect("chunk offsets").entries;
        let mut sizes = sizes.iter();
        let mut samples = Vec::new();
        for (chunk, &offset) in self.stbl.stsc.entries.iter().zip(offsets) {
            let Codec::Avc1(description) =
                &self.stbl.stsd.codecs[chunk.sample_description_index as usize - 1]
            else {
                panic!("not avc1")
            };
            let mut at = offset as usize;
            for _ in 0..chunk.samples_per_chunk {
                let size = *sizes.next().expect("a size for each sample") as usize;
                samples.push((description, &self.file[at..at + size]));
                at += size;
            }
        }
        assert_eq!(sizes.next(), None, "samples outside of any chunk");
        samples
    }

    /// The samples as access units in Annex B form.
    fn access_units(&self) -> Vec<AccessUnit> {
        let key_frames = &self.stbl.stss.as_ref().expect("key frames").entries;
        let access_unit = |(number, (description, sample)): (u32, (&Avc1, &[u8]))| {
            let key_frame = key_frames.contains(&number);
            let mut bytes = Vec::new();
            let avcc = &description.avcc;
            if key_frame {
                for set in avcc.sequence_parameter_sets.iter().chain(&avcc.picture_parameter_sets) {
                    bytes.extend([&[0, 0, 0, 1], &set[..]].concat());
                }
            }
            let mut rest = sample;
            while let Some((length, tail)) = rest.split_first_chunk::<4>() {
                let (unit, tail) = tail.split_at(u32::from_be_bytes(*length) as usize);
                bytes.extend([&[0, 0, 0, 1], unit].concat());
                rest = tail;
            }
            AccessUnit { bytes, key_frame }
        };
        (1..).zip(self.samples()).map(access_unit).collect()
    }

    fn durations(&self) -> Vec<u32> {
        let entries = self.stbl.stts.entries.iter();
        entries
            .flat_map(|entry| std::iter::repeat_n(entry.sample_delta, entry.sample_count as usize))
            .collect()
    }
}

#[test]
fn what_is_recorded_plays_back_bit_for_bit_and_at_its_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("left.mp4");
    let mut recording = Recording::create(&path).unwrap();
    let mut encoder = encoder(640, 180);
    let mut sent = Vec::new();
    let mut time = Duration::from_secs(1000);
    for frame in 0..150u32 {
        let access_unit = encoder.encode(picture(640, 180, frame).as_frame(), frame == 70).unwrap();
        recording.add(&access_unit, time).unwrap();
        sent.push(access_unit);
        // Every tenth picture was late.
        time += Duration::from_micros(if frame % 10 == 9 { 33_333 } else { 16_667 });
    }
    let summary = recording.finish().unwrap();
    assert_eq!(summary.bytes, std::fs::metadata(&path).unwrap().len());
    assert_eq!((summary.pictures, &summary.path), (150, &path));

    let player = Player::open(&path);
    assert_eq!(player.window, (640, 180));
    let played = player.access_units();
    assert_eq!(played.iter().map(|unit| unit.key_frame).collect::<Vec<_>>(), {
        let mut keys = [false; 150];
        (keys[0], keys[70]) = (true, true);
        keys
    });
    let (mut decoder, mut other) = (Decoder::new().unwrap(), Decoder::new().unwrap());
    for (played, sent) in played.iter().zip(&sent) {
        assert_eq!(decoder.decode(&played.bytes).unwrap(), other.decode(&sent.bytes).unwrap());
    }
    let durations = player.durations();
    assert_eq!(durations.len(), 150);
    for (frame, ticks) in durations[..149].iter().enumerate() {
        let expected = if frame % 10 == 9 { 3000 } else { 1500 };
        assert!(ticks.abs_diff(expected) <= 1, "picture {frame} is shown for {ticks} ticks");
    }
    // 14 late gaps and the last picture's own time as long as the gap before it.
    assert_eq!(durations.iter().map(|&ticks| u64::from(ticks)).sum::<u64>(), player.duration_ticks);
    assert!(summary.duration.abs_diff(Duration::from_micros(136 * 16_667 + 14 * 33_333)).as_micros() < 50);
}

#[test]
fn a_stream_may_change_its_size_at_a_key_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sizes.mp4");
    let mut recording = Recording::create(&path).unwrap();
    let mut time = Duration::ZERO;
    for (width_px, height_px) in [(640, 180), (320, 90), (640, 180)] {
        let mut encoder = encoder(width_px, height_px);
        for frame in 0..4 {
            let access_unit = encoder.encode(picture(width_px, height_px, frame).as_frame(), false).unwrap();
            recording.add(&access_unit, time).unwrap();
            time += Duration::from_millis(20);
        }
    }
    recording.finish().unwrap();
    let player = Player::open(&path);
    assert_eq!(player.window, (640, 180));
    let mut decoder = Decoder::new().unwrap();
    let widths: Vec<u32> = player
        .access_units()
        .iter()
        .map(|unit| decoder.decode(&unit.bytes).unwrap().layout().width_px())
        .collect();
    assert_eq!(widths, [640, 640, 640, 640, 320, 320, 320, 320, 640, 640, 640, 640]);
}

#[test]
fn what_cannot_be_played_is_refused_and_the_rest_stays_good() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("refused.mp4");
    let mut recording = Recording::create(&path).unwrap();
    let mut encoder = encoder(320, 90);
    let mut next = |frame| encoder.encode(picture(320, 90, frame).as_frame(), false).unwrap();
    let (key, second, third) = (next(0), next(1), next(2));
    let ms = Duration::from_millis;

    assert!(matches!(recording.add(&second, ms(0)), Err(RecordingError::NoKeyFrame)));
    recording.add(&key, ms(100)).unwrap();
    for earlier in [0, 99, 100] {
        let refused = recording.add(&second, ms(earlier)).unwrap_err();
        assert!(matches!(refused, RecordingError::NotLater { .. }), "{refused}");
    }
    let garbage = AccessUnit { bytes: vec![1, 2, 3], key_frame: false };
    assert!(matches!(recording.add(&garbage, ms(110)), Err(RecordingError::NoSlice { bytes: 3 })));
    let no_sets = AccessUnit { key_frame: true, ..second.clone() };
    assert!(matches!(recording.add(&no_sets, ms(110)), Err(RecordingError::ParameterSets(_))));
    let day_later = ms(100) + Duration::from_secs(86_400);
    assert!(matches!(recording.add(&second, day_later), Err(RecordingError::TooLate { .. })));
    recording.add(&second, ms(120)).unwrap();
    recording.add(&third, ms(140)).unwrap();
    assert_eq!(recording.finish().unwrap().pictures, 3);

    let mut decoder = Decoder::new().unwrap();
    for unit in Player::open(&path).access_units() {
        decoder.decode(&unit.bytes).unwrap();
    }
}

#[test]
fn an_unfinished_recording_leaves_nothing_and_touches_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("kept.mp4");
    std::fs::write(&path, b"the recording of yesterday").unwrap();
    let mut recording = Recording::create(&path).unwrap();
    recording
        .add(&encoder(320, 90).encode(picture(320, 90, 0).as_frame(), false).unwrap(), Duration::ZERO)
        .unwrap();
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    drop(recording);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    assert_eq!(std::fs::read(&path).unwrap(), b"the recording of yesterday");
}

#[test]
fn an_empty_recording_is_an_error_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let recording = Recording::create(folder.path().join("empty.mp4")).unwrap();
    assert!(matches!(recording.finish(), Err(RecordingError::Empty)));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_folder_that_is_not_there_is_named() {
    let error = Recording::create("no/such/folder/video.mp4").err().unwrap();
    assert_eq!(error.to_string(), "cannot create the file no/such/folder/video.mp4.part");
}
