//! What is written to the disk: some pictures, and the whole stream as a video file.

use codec::{AccessUnit, YuvPicture};
use image::ExtendedColorType;
use recording::{Recording, RecordingError};
use serde::Serialize;
use session::ReceivedFrame;
use spatial::Pose;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread;
use std::time::Duration;
use tokio::sync::oneshot;

/// What waits for the disk: some seconds of stream. A disk that is farther behind ends the recording.
const QUEUE: usize = 512;
/// Pictures among it, which are large; further ones are not kept.
const MAX_PICTURES_WAITING: usize = 4;
/// Two pictures cannot be shown at the same time. Those that come in one display interval are told apart by this.
const SHORTEST_SHOW: Duration = Duration::from_micros(100);

/// What is to be written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KeepSettings {
    /// Pictures as PNG, left and right, with a JSON beside that tells what they show.
    pub pictures: Option<PictureSettings>,
    /// All decoded access units as an MP4 file, as they came.
    pub recording: Option<PathBuf>,
}

/// Which pictures are written, and where.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureSettings {
    /// The directory; it is made if it is not there.
    pub directory: PathBuf,
    /// Which.
    pub choice: PictureChoice,
}

/// Which pictures are written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PictureChoice {
    /// The first decoded picture and then every so many; at least every one.
    Every(u64),
    /// So many, evenly spread over a time: each is the first one that is decoded after the middle of its part.
    Spread {
        /// How many.
        count: u32,
        /// Over how many seconds.
        seconds: f64,
    },
}

/// Why something was not written.
#[derive(Debug, thiserror::Error)]
pub enum KeepError {
    /// A file or directory.
    #[error("cannot write {}: {source}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A PNG file.
    #[error("cannot write {}: {source}", path.display())]
    Picture {
        /// Which.
        path: PathBuf,
        /// What the encoder said.
        source: image::ImageError,
    },
    /// The recording.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The disk does not follow.
    #[error("the recording {} was given up: the disk is slower than the stream", path.display())]
    TooSlow {
        /// The recording.
        path: PathBuf,
    },
    /// The thread that writes could not be started.
    #[error("cannot start a thread: {source}")]
    Thread {
        /// What the system said.
        source: io::Error,
    },
}

/// What was written.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Kept {
    /// Frames whose pictures were written.
    pub pictures: Vec<u64>,
    /// Frames whose pictures were chosen and not written, because the disk did not follow.
    pub pictures_skipped: u64,
    /// The recording, if one was asked for and is whole.
    pub recording: Option<KeptRecording>,
    /// What went wrong, in words.
    pub errors: Vec<String>,
}

/// A finished recording.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KeptRecording {
    /// The file.
    pub path: PathBuf,
    /// Its length.
    pub bytes: u64,
    /// Pictures in it.
    pub pictures: usize,
    /// How long it plays, in seconds.
    pub seconds: f64,
}

/// Chooses what is kept and hands it to a thread that writes, so that the disk delays no frame.
pub(crate) struct Keeper {
    choice: Option<PictureChoice>,
    seen: u64,
    chosen: u32,
    pictures_skipped: u64,
    records: bool,
    too_slow: bool,
    waiting: Arc<AtomicUsize>,
    queue: SyncSender<Item>,
    done: oneshot::Receiver<Kept>,
    recording: Option<PathBuf>,
}

enum Item {
    Unit { unit: AccessUnit, shown_at: Duration },
    Picture(Box<Picture>),
}

struct Picture {
    number: u64,
    picture: YuvPicture,
    description: Description,
}

/// The JSON beside a picture.
#[derive(Serialize)]
struct Description {
    frame: u64,
    pose_sequence: u64,
    scene_revision: u32,
    time_step: u32,
    key_frame: bool,
    pose_sampled_at_secs: f64,
    display_at_secs: f64,
    decoded_at_secs: f64,
    resolution_scale: f32,
    step_scale: f32,
    eyes: [EyeDescription; 2],
    violations: Vec<String>,
}

#[derive(Serialize)]
struct EyeDescription {
    file: String,
    size_px: [u32; 2],
    world_from_eye: PoseDescription,
    fov_deg: FovDescription,
}

#[derive(Serialize)]
struct PoseDescription {
    position_m: [f64; 3],
    orientation_xyzw: [f64; 4],
}

#[derive(Serialize)]
struct FovDescription {
    left: f64,
    right: f64,
    up: f64,
    down: f64,
}

/// A decoded frame as the keeper sees it. Times are seconds of the run.
pub(crate) struct Shown<'a> {
    pub(crate) received: &'a ReceivedFrame,
    pub(crate) pose_sampled_at_secs: f64,
    pub(crate) display_at_secs: f64,
    pub(crate) decoded_at_secs: f64,
    /// Seconds since the headset's own beginning.
    pub(crate) since_start_secs: f64,
    pub(crate) violations: Vec<String>,
}

impl Keeper {
    /// Begins to write; `None` if nothing is to be written.
    pub(crate) fn start(name: &str, settings: &KeepSettings) -> Result<Option<Self>, KeepError> {
        if *settings == KeepSettings::default() {
            return Ok(None);
        }
        if let Some(PictureSettings { directory, .. }) = &settings.pictures {
            fs::create_dir_all(directory)
                .map_err(|source| KeepError::File { path: directory.clone(), source })?;
        }
        let recording = settings.recording.clone().map(Recording::create).transpose()?;
        let directory = settings.pictures.as_ref().map(|pictures| pictures.directory.clone());
        let waiting = Arc::new(AtomicUsize::new(0));
        let (queue, items) = sync_channel(QUEUE);
        let (kept, done) = oneshot::channel();
        let (records, waits) = (recording.is_some(), waiting.clone());
        thread::Builder::new()
            .name(format!("keep-{name}"))
            .spawn(move || {
                // A headset that is gone does not want to know.
                let _ = kept.send(write(&items, directory.as_deref(), recording, &waits));
            })
            .map_err(|source| KeepError::Thread { source })?;
        Ok(Some(Self {
            choice: settings.pictures.as_ref().map(|pictures| pictures.choice),
            seen: 0,
            chosen: 0,
            pictures_skipped: 0,
            records,
            too_slow: false,
            waiting,
            queue,
            done,
            recording: settings.recording.clone(),
        }))
    }

    /// Takes a decoded frame.
    pub(crate) fn take(&mut self, shown: &Shown<'_>, picture: YuvPicture) {
        let header = &shown.received.header;
        if self.records {
            let unit = AccessUnit {
                bytes: shown.received.access_unit().to_vec(),
                key_frame: header.depends_on.is_none(),
            };
            // A headset shows a picture at its display time, or as soon as it has it.
            let shown_at = shown.display_at_secs.max(shown.decoded_at_secs).max(0.0);
            let item = Item::Unit { unit, shown_at: Duration::from_secs_f64(shown_at) };
            if let Err(TrySendError::Full(_)) = self.queue.try_send(item) {
                // With one frame missing, the next ones show garbage.
                (self.records, self.too_slow) = (false, true);
            }
        }
        let is_chosen = self.chooses(shown.since_start_secs);
        self.seen += 1;
        if !is_chosen {
            return;
        }
        self.chosen += 1;
        let item = Item::Picture(Box::new(Picture {
            number: header.frame,
            description: describe(shown, &picture),
            picture,
        }));
        if self.waiting.fetch_add(1, Ordering::Relaxed) >= MAX_PICTURES_WAITING
            || self.queue.try_send(item).is_err()
        {
            self.waiting.fetch_sub(1, Ordering::Relaxed);
            self.pictures_skipped += 1;
        }
    }

    fn chooses(&self, since_start_secs: f64) -> bool {
        match self.choice {
            None => false,
            Some(PictureChoice::Every(every)) => self.seen.is_multiple_of(every.max(1)),
            Some(PictureChoice::Spread { count, seconds }) => {
                let part = seconds / f64::from(count.max(1));
                self.chosen < count && since_start_secs >= (f64::from(self.chosen) + 0.5) * part
            }
        }
    }

    /// Waits until all is on the disk.
    pub(crate) async fn finish(self) -> Kept {
        drop(self.queue);
        // The thread answers unless it has panicked.
        let mut kept = self.done.await.unwrap_or_else(|_| Kept {
            errors: vec!["the thread that writes has failed".to_owned()],
            ..Kept::default()
        });
        kept.pictures_skipped += self.pictures_skipped;
        if self.too_slow
            && let Some(path) = self.recording
        {
            kept.errors.push(KeepError::TooSlow { path }.to_string());
        }
        kept
    }
}

fn describe(shown: &Shown<'_>, picture: &YuvPicture) -> Description {
    let ReceivedFrame { header, view, .. } = shown.received;
    let eye = |eye: usize| {
        let Pose { position_m, orientation } = view.eyes[eye].world_from_eye;
        let fov = view.eyes[eye].fov;
        EyeDescription {
            file: file_name(header.frame, eye),
            size_px: [picture.layout().width_px() / 2, picture.layout().height_px()],
            world_from_eye: PoseDescription {
                position_m: position_m.to_array(),
                orientation_xyzw: orientation.to_array(),
            },
            fov_deg: FovDescription {
                left: fov.left.to_degrees(),
                right: fov.right.to_degrees(),
                up: fov.up.to_degrees(),
                down: fov.down.to_degrees(),
            },
        }
    };
    Description {
        frame: header.frame,
        pose_sequence: header.pose_sequence,
        scene_revision: header.scene_revision,
        time_step: header.time_step,
        key_frame: header.depends_on.is_none(),
        pose_sampled_at_secs: shown.pose_sampled_at_secs,
        display_at_secs: shown.display_at_secs,
        decoded_at_secs: shown.decoded_at_secs,
        resolution_scale: header.quality.resolution_scale,
        step_scale: header.quality.step_scale,
        eyes: [eye(0), eye(1)],
        violations: shown.violations.clone(),
    }
}

fn file_name(frame: u64, eye: usize) -> String {
    format!("frame-{frame:06}-{}.png", if eye == 0 { "left" } else { "right" })
}

/// The thread that writes.
fn write(
    items: &Receiver<Item>,
    directory: Option<&Path>,
    mut recording: Option<Recording>,
    waiting: &AtomicUsize,
) -> Kept {
    let mut kept = Kept::default();
    let mut shown = Duration::ZERO;
    for item in items {
        match (item, directory) {
            (Item::Unit { unit, shown_at }, _) => {
                let Some(into) = &mut recording else {
                    continue;
                };
                shown = shown_at.max(shown + SHORTEST_SHOW);
                if let Err(error) = into.add(&unit, shown) {
                    kept.errors.push(error.to_string());
                    recording = None;
                }
            }
            (Item::Picture(picture), Some(directory)) => {
                match write_picture(directory, &picture) {
                    Ok(()) => kept.pictures.push(picture.number),
                    Err(error) => kept.errors.push(error.to_string()),
                }
                waiting.fetch_sub(1, Ordering::Relaxed);
            }
            (Item::Picture(_), None) => {}
        }
    }
    match recording.map(Recording::finish) {
        Some(Ok(summary)) => {
            kept.recording = Some(KeptRecording {
                path: summary.path,
                bytes: summary.bytes,
                pictures: summary.pictures,
                seconds: summary.duration.as_secs_f64(),
            });
        }
        Some(Err(error)) => kept.errors.push(error.to_string()),
        None => {}
    }
    kept
}

fn write_picture(directory: &Path, picture: &Picture) -> Result<(), KeepError> {
    let rgb = picture.picture.to_rgb8();
    let layout = picture.picture.layout();
    let (width, height) = (layout.width_px() / 2, layout.height_px());
    for eye in 0..2 {
        let half: Vec<u8> = rgb
            .chunks_exact(6 * width as usize)
            .flat_map(|row| &row[3 * width as usize * eye..][..3 * width as usize])
            .copied()
            .collect();
        let path = directory.join(file_name(picture.number, eye));
        image::save_buffer(&path, &half, width, height, ExtendedColorType::Rgb8)
            .map_err(|source| KeepError::Picture { path, source })?;
    }
    let path = directory.join(format!("frame-{:06}.json", picture.number));
    // Only a map with keys that are no text, or a failing writer, could fail; there is neither.
    let json = serde_json::to_string_pretty(&picture.description).expect("a description is plain data");
    fs::write(&path, json + "\n").map_err(|source| KeepError::File { path, source })
}
