//! The command line.

use clap::{Args, Parser, Subcommand};
use std::net::SocketAddr;
use std::path::PathBuf;

/// Remote stereo volume rendering for headsets.
///
/// A server with a GPU holds a medical volume; headsets send where they look and get back what they see, 60 times a
/// second. Start with: holocast serve --volume SCAN.nii.gz
#[derive(Debug, Parser)]
#[command(version, max_term_width = 110)]
pub(crate) struct Cli {
    /// Say more on standard error (-vv: everything)
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub(crate) verbose: u8,
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Serve a volume to headsets
    Serve(Serve),
    /// Be a headset: replay a trace of head poses, decode and check every frame, report where the time went
    Headset(HeadsetArguments),
    /// Be many headsets at once, each with its own connection, phase and place in its trace
    Load(Load),
    /// Draw a still picture of a scene, without a network
    Render(Render),
    /// Say how far one picture is from another: PNG or float data
    Compare(Compare),
    /// Measure this machine and what it draws
    #[command(subcommand)]
    Bench(Bench),
    /// Say what a volume is: dimensions, spacing, orientation, type, range, histogram
    Info(Info),
    /// Write a volume as NIfTI, NRRD or slice atlas, whole or a part of it
    Convert(Convert),
    /// List the presets: looks by name, with the modality and the units that they are for
    Presets {
        /// As JSON
        #[arg(long)]
        json: bool,
    },
    /// Draw every volume below some folders in a look that fits it, on one sheet
    ContactSheet(ContactSheet),
    /// Name the graphics adapters of this machine
    Adapters {
        /// As JSON
        #[arg(long)]
        json: bool,
    },
}

/// Which images of a folder.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct Chosen {
    /// The DICOM series, by its number or UID; by default the one with the most images
    #[arg(long, value_name = "NUMBER|UID")]
    pub(crate) series: Option<String>,
    /// Which volume of a series in time, counted from 0 (info says how many there are)
    #[arg(long, value_name = "INDEX", default_value_t = 0)]
    pub(crate) time: u64,
    /// Load a folder although it has images of several patients
    #[arg(long)]
    pub(crate) force: bool,
    /// What the numbers of a one-channel file are, where the file does not say: intensity (measured) or label
    #[arg(long, value_name = "KIND", hide_possible_values = true)]
    pub(crate) kind: Option<Kind>,
}

/// What the numbers of a channel are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Kind {
    /// Measured values
    Intensity,
    /// Labels: numbers that name structures
    Label,
}

/// How the volume looks; what is named here goes before the scene.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct Look {
    /// A look by name; `holocast presets` lists them
    #[arg(long, value_name = "NAME")]
    pub(crate) preset: Option<String>,
    /// A transfer function of another program: a volume property (.vp) or presets.xml#NAME of 3D Slicer, or a colour map
    /// of ParaView (JSON or XML)
    #[arg(long, value_name = "FILE[#NAME]")]
    pub(crate) transfer: Option<String>,
    /// Names and colours of labels: a colour table of 3D Slicer or ITK-SNAP, or JSON
    #[arg(long, value_name = "FILE")]
    pub(crate) labels: Option<PathBuf>,
    /// What took the images, where the file does not say it or says it wrong: CT, MR, PT, ...
    #[arg(long, value_name = "CODE")]
    pub(crate) modality: Option<String>,
}

/// What to measure.
#[derive(Debug, Subcommand)]
pub(crate) enum Bench {
    /// How far the hologram seems to be from where it is, by the age of the pose and the speed of the head
    Registration(Registration),
    /// What each quality costs, and how far its picture is from the exact one
    Accuracy(BenchAccuracy),
    /// What a stereo frame costs, and how much of it is spent on what is seen
    Render(BenchRender),
    /// How cost grows with pixels, voxels, matter and headsets
    Scale(BenchScale),
}

/// Replays recorded heads in virtual time and tells the registration error at each age of the pose, with the server's
/// prediction and without; no network, and the same figures each time. See docs/registration.md.
#[derive(Debug, Args)]
pub(crate) struct Registration {
    /// The traces of head poses (docs/trace-format.md); may be given several times
    #[arg(long, required = true, value_name = "FILE")]
    pub(crate) trace: Vec<PathBuf>,
    /// hololens1, hololens2, or the pixels of one eye as WxH
    #[arg(long, default_value = "hololens1", value_name = "DEVICE")]
    pub(crate) device: String,
    /// Poses a second
    #[arg(long, default_value_t = 60.0, value_name = "HZ")]
    pub(crate) hz: f32,
    /// Ages of the pose when its picture is shown, milliseconds: from 0 to this ...
    #[arg(long, default_value_t = 100.0, value_name = "MS")]
    pub(crate) longest_ms: f64,
    /// ... in steps of this
    #[arg(long, default_value_t = 10.0, value_name = "MS")]
    pub(crate) step_ms: f64,
    /// How far before the head the hologram is, metres
    #[arg(long, default_value_t = 2.0, value_name = "M")]
    pub(crate) distance_m: f64,
    /// Compare exact pictures of this scene too, at the predicted and the true view (JSON, see docs/scene-format.md)
    #[arg(long, value_name = "FILE")]
    pub(crate) scene: Option<PathBuf>,
    /// The volume; by default the one that the scene names, relative to the scene's file
    #[arg(long, value_name = "FILE")]
    pub(crate) volume: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) chosen: Chosen,
    /// Ages at which pictures are compared, milliseconds
    #[arg(long, value_delimiter = ',', default_value = "20,50,100", value_name = "MS,...")]
    pub(crate) picture_ages_ms: Vec<f64>,
    /// Pictures compared at each age, spread over each trace
    #[arg(long, default_value_t = 12, value_name = "N")]
    pub(crate) pictures: usize,
    /// Width and height of these pictures; exact pictures are slow
    #[arg(long, default_value = "160x90", value_name = "WxH")]
    pub(crate) picture_size: Size,
    /// Write the figures here (JSON)
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    /// Write a line for each pose and age here (CSV)
    #[arg(long, value_name = "FILE")]
    pub(crate) csv: Option<PathBuf>,
    /// Plot error in degrees against age here, a plot for each head (PNG or SVG); beside it, named after it, in pixels
    /// (-px), by the head's speed (-speed), and what it does to exact pictures (-db)
    #[arg(long, value_name = "FILE")]
    pub(crate) plot: Option<PathBuf>,
    /// The figures as JSON on standard output, instead of a table
    #[arg(long)]
    pub(crate) json: bool,
}

/// Serve a volume to headsets.
#[derive(Debug, Args)]
pub(crate) struct Serve {
    /// The volume, a file or a folder of DICOM files; by default the one that the scene names, relative to the scene's
    /// file
    #[arg(long, value_name = "PATH")]
    pub(crate) volume: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) chosen: Chosen,
    /// The scene to begin with (JSON, see docs/scene-format.md); without one, the volume in default colours
    #[arg(long, value_name = "FILE")]
    pub(crate) scene: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) look: Look,
    /// Where to listen (UDP)
    #[arg(long, default_value = "0.0.0.0:4433", value_name = "ADDRESS:PORT")]
    pub(crate) listen: SocketAddr,
    /// Use the adapter whose name contains this; `holocast adapters` names them
    #[arg(long, value_name = "NAME")]
    pub(crate) adapter: Option<String>,
    /// Keep certificate and key here; made at the first start
    #[arg(long, value_name = "DIR")]
    pub(crate) identity: Option<PathBuf>,
    /// What headsets must know to see; without it everyone who reaches the port sees
    #[arg(long, value_name = "CODE")]
    pub(crate) pairing_code: Option<String>,
    /// What a frame may cost when there is time: draft, balanced, fine, exact
    #[arg(long, default_value = "balanced", value_name = "LEVEL")]
    pub(crate) quality: String,
    /// Do not lower the quality to hold the rate
    #[arg(long)]
    pub(crate) fixed_quality: bool,
    /// Render for poses as they come, not for where the head will be
    #[arg(long)]
    pub(crate) no_prediction: bool,
    /// Most headsets at a time
    #[arg(long, default_value_t = 64, value_name = "N")]
    pub(crate) max_headsets: usize,
    /// Bits a pixel of the stream
    #[arg(long, default_value_t = 0.15, value_name = "BITS")]
    pub(crate) bits_per_pixel: f64,
    /// Threads that encode; by default half the cores
    #[arg(long, value_name = "N")]
    pub(crate) encoder_threads: Option<usize>,
    /// Frames on the device at a time: 1 takes the pose last, 2 keep a fast device busy. By default 1 on a software
    /// driver, else 2
    #[arg(long, value_name = "N")]
    pub(crate) device_queue: Option<usize>,
    /// Most megabytes of memory for the steps of a series in time that is played; what is beyond is read from the file
    /// each time that it is its turn
    #[arg(long, default_value_t = 4096, value_name = "MB")]
    pub(crate) series_memory_mb: usize,
    /// Where it listens, what headsets pin and what it shows, as one line of JSON on standard output
    #[arg(long)]
    pub(crate) json: bool,
}

/// What one and many simulated headsets are told.
#[derive(Debug, Args)]
pub(crate) struct Simulated {
    /// The server
    #[arg(long, value_name = "HOST:PORT")]
    pub(crate) connect: String,
    /// The fingerprint of the server's certificate, as the server prints it
    #[arg(long, value_name = "SHA-256")]
    pub(crate) fingerprint: String,
    /// The code that the server asks for
    #[arg(long, default_value = "", value_name = "CODE", hide_default_value = true)]
    pub(crate) pairing_code: String,
    /// hololens1, hololens2, or the pixels of one eye as WxH
    #[arg(long, default_value = "hololens1", value_name = "DEVICE")]
    pub(crate) device: String,
    /// Poses, and so frames, a second
    #[arg(long, default_value_t = 60.0, value_name = "HZ")]
    pub(crate) hz: f32,
    /// For how long
    #[arg(long, default_value_t = 10.0, value_name = "N")]
    pub(crate) seconds: f64,
    /// What follows a trace's end: loop, hold, ping-pong
    #[arg(long, default_value = "ping-pong", value_name = "ENDING")]
    pub(crate) ending: String,
    /// Replay the trace where it was recorded. Without this it is turned and moved so that it begins in front of the
    /// hologram, and its gaze is held within reach of it
    #[arg(long)]
    pub(crate) as_recorded: bool,
    /// Where the hologram is, metres in the room
    #[arg(long, default_value = "0,1.5,-2", value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub(crate) hologram: String,
    /// How far from it a trace begins, metres
    #[arg(long, default_value_t = 1.6, value_name = "M")]
    pub(crate) distance_m: f64,
    /// From which side, degrees about the vertical
    #[arg(long, default_value_t = 0.0, value_name = "DEG", allow_hyphen_values = true)]
    pub(crate) azimuth_deg: f64,
    /// Ask for another scene after so many seconds: SECONDS:SCENE.json, may be given several times
    #[arg(long, value_name = "SECONDS:FILE")]
    pub(crate) change_scene: Vec<String>,
    /// Write the report here (JSON, see docs/report-format.md)
    #[arg(long, value_name = "FILE")]
    pub(crate) report: Option<PathBuf>,
    /// Write every frame's times here (CSV)
    #[arg(long, value_name = "FILE")]
    pub(crate) frames_csv: Option<PathBuf>,
    /// Paint the stages of each frame over time here (PNG)
    #[arg(long, value_name = "FILE")]
    pub(crate) latency_plot: Option<PathBuf>,
    /// The report as JSON on standard output, instead of a table
    #[arg(long)]
    pub(crate) json: bool,
}

/// Be a headset.
#[derive(Debug, Args)]
pub(crate) struct HeadsetArguments {
    #[command(flatten)]
    pub(crate) simulated: Simulated,
    /// The trace of head poses: eye-pair CSV, motion-capture JSON, TUM text or JSON lines (docs/trace-format.md), or
    /// `orbit`
    #[arg(long, value_name = "FILE")]
    pub(crate) trace: String,
    /// Its name in the report; by default the trace's
    #[arg(long, value_name = "NAME")]
    pub(crate) name: Option<String>,
    /// Write decoded pictures here, left and right (PNG)
    #[arg(long, value_name = "DIR")]
    pub(crate) save: Option<PathBuf>,
    /// How many pairs, spread over the run
    #[arg(long, default_value_t = 6, value_name = "N")]
    pub(crate) save_count: u32,
    /// When the run is over, hold so many decoded pairs, spread over it, against the exact pictures of the view that
    /// they were made for and of the view when they were shown. Slow: seconds a picture, so keep --device small
    #[arg(long, value_name = "N")]
    pub(crate) verify: Option<u32>,
    /// For --verify: the volume that the server shows; by default the one that --scene names
    #[arg(long, value_name = "FILE", requires = "verify")]
    pub(crate) volume: Option<PathBuf>,
    /// For --verify: the scene that the server shows at the beginning; without one, the volume in default colours
    #[arg(long, value_name = "FILE", requires = "verify")]
    pub(crate) scene: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) chosen: Chosen,
    /// Write the stream as it came here (MP4)
    #[arg(long, value_name = "FILE")]
    pub(crate) record: Option<PathBuf>,
}

/// Be many headsets.
#[derive(Debug, Args)]
pub(crate) struct Load {
    #[command(flatten)]
    pub(crate) simulated: Simulated,
    /// How many headsets
    #[arg(long, value_name = "N")]
    pub(crate) headsets: usize,
    /// How many of them come in a second; all at once without it
    #[arg(long, default_value_t = 0.0, value_name = "PER_SECOND", hide_default_value = true)]
    pub(crate) ramp: f64,
    /// Traces, replayed in turn; may be given several times. Without one, each walks in a circle around the hologram
    #[arg(long, value_name = "FILE")]
    pub(crate) trace: Vec<String>,
}

/// Draw a still picture.
#[derive(Debug, Args)]
pub(crate) struct Render {
    /// The scene (JSON, see docs/scene-format.md); without one, the volume in default colours
    #[arg(long, value_name = "FILE")]
    pub(crate) scene: Option<PathBuf>,
    /// The volume, a file or a folder of DICOM files; by default the one that the scene names, relative to the scene's
    /// file
    #[arg(long, value_name = "PATH")]
    pub(crate) volume: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) chosen: Chosen,
    #[command(flatten)]
    pub(crate) look: Look,
    /// What the picture may cost: draft, balanced, fine, exact
    #[arg(long, default_value = "fine", value_name = "LEVEL")]
    pub(crate) quality: String,
    /// The exact picture in float64, as docs/picture.md defines it: on all cores, without a GPU, slowly
    #[arg(long, conflicts_with_all = ["quality", "frames", "step_mm", "tune", "no_skip", "adapter"])]
    pub(crate) reference: bool,
    /// The picture to write: a PNG before the scene's background, or float data (.npy, see docs/picture-format.md)
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,
    /// Write float data here too
    #[arg(long, value_name = "FILE")]
    pub(crate) data: Option<PathBuf>,
    /// Both eyes, side by side
    #[arg(long)]
    pub(crate) stereo: bool,
    /// Distance of the eyes in millimetres, for --stereo
    #[arg(long, default_value_t = 64.0, value_name = "MM")]
    pub(crate) eye_distance_mm: f64,
    /// Draw this many times and report minimum and median
    #[arg(long, default_value_t = 1, value_name = "N")]
    pub(crate) frames: usize,
    /// Width and height of one eye's picture; by default the scene's, else 1280x720
    #[arg(long, value_name = "WxH")]
    pub(crate) size: Option<Size>,
    /// Distance of samples along a ray in millimetres, instead of the quality's
    #[arg(long, value_name = "MM")]
    pub(crate) step_mm: Option<f64>,
    /// Change a number of the level: step_voxels, refined_parts, refined_above, light_span_voxels, light_weight,
    /// interpolated_below, least_transmittance or resolution_scale (docs/accuracy.md says what each costs); may be given
    /// several times
    #[arg(long, value_name = "NAME=NUMBER", value_parser = tuned)]
    pub(crate) tune: Vec<(String, f64)>,
    /// Look at every sample, also where nothing is to be seen (to measure what skipping brings)
    #[arg(long)]
    pub(crate) no_skip: bool,
    /// Use the adapter whose name contains this
    #[arg(long, value_name = "NAME")]
    pub(crate) adapter: Option<String>,
    /// Figures as JSON on standard output
    #[arg(long)]
    pub(crate) json: bool,
}

/// Draw every volume on one sheet.
///
/// Loads each volume below the folders, draws it with the preset that fits it and from where it fills its tile, and writes
/// one PNG with captions. What cannot be loaded or drawn is named on the sheet and makes the command fail. Whatever files
/// say of a patient's identity is not shown; names of files are.
#[derive(Debug, Args)]
pub(crate) struct ContactSheet {
    /// Volumes, or folders in which they are looked for
    #[arg(required = true, value_name = "PATH")]
    pub(crate) paths: Vec<PathBuf>,
    /// The sheet to write (PNG)
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,
    /// Width and height of a picture
    #[arg(long, default_value = "240x180", value_name = "WxH")]
    pub(crate) size: Size,
    /// Pictures in a row
    #[arg(long, default_value_t = 6, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    pub(crate) columns: u32,
    /// What a picture may cost: draft, balanced, fine, exact
    #[arg(long, default_value = "balanced", value_name = "LEVEL")]
    pub(crate) quality: String,
    /// Use the adapter whose name contains this
    #[arg(long, value_name = "NAME")]
    pub(crate) adapter: Option<String>,
    /// What is on it, as JSON on standard output
    #[arg(long)]
    pub(crate) json: bool,
}

/// Say how far one picture is from another.
#[derive(Debug, Args)]
pub(crate) struct Compare {
    /// A picture: PNG or float data (.npy, see docs/picture-format.md)
    pub(crate) a: PathBuf,
    /// Another one of the same size
    pub(crate) b: PathBuf,
    /// Fail if a sample differs by more than this: a part of full brightness, such as 0.002 or 0.5/255
    #[arg(long, value_name = "X")]
    pub(crate) max_error: Option<Part>,
    /// Paint the difference here (PNG)
    #[arg(long, value_name = "FILE")]
    pub(crate) difference: Option<PathBuf>,
    /// How much brighter than it is; by default so that the worst sample is white
    #[arg(long, value_name = "N", value_parser = positive, requires = "difference")]
    pub(crate) gain: Option<f64>,
    /// What to put transparent pictures before if the other is an opaque PNG: R,G,B, 0 to 1
    #[arg(long, default_value = "0,0,0", value_name = "R,G,B")]
    pub(crate) background: Color,
    /// Figures as JSON on standard output
    #[arg(long)]
    pub(crate) json: bool,
}

/// What each quality costs, and how far its picture is from the exact one.
///
/// Draws every scene with every setting of quality, holds the pictures against the exact ones and times the frames.
/// Writes accuracy.json, accuracy.csv, max-error.png, rmse.png and both as SVG. An interrupted run goes on where it was;
/// exact pictures are kept and taken again for scenes that have not changed.
#[derive(Debug, Args)]
pub(crate) struct BenchAccuracy {
    /// Scenes, or folders of scenes
    #[arg(long, num_args = 1.., default_value = "assets/scenes", value_name = "FILE")]
    pub(crate) scene: Vec<PathBuf>,
    /// Where results, exact pictures and what was measured so far are kept
    #[arg(long, default_value = "out/accuracy", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Width and height of the pictures
    #[arg(long, default_value = "320x180", value_name = "WxH")]
    pub(crate) size: Size,
    /// Frames to time for each setting; fewer, but three, where they take long
    #[arg(long, default_value_t = 9, value_name = "N")]
    pub(crate) frames: usize,
    /// Only settings of this name, such as draft or 'hardware step 0.5'; may be given several times
    #[arg(long, value_name = "NAME")]
    pub(crate) setting: Vec<String>,
    /// Use the adapter whose name contains this
    #[arg(long, value_name = "NAME")]
    pub(crate) adapter: Option<String>,
    /// What holds for each level as JSON on standard output, instead of a table
    #[arg(long)]
    pub(crate) json: bool,
}

/// What a stereo frame costs, and how much of it is spent on what is seen.
///
/// For each scene, size and setting: times of frames, and of their ray-cast and conversion by the device's own clock; samples
/// taken and samples that contribute, counted by the shaders; the same rays read by a bare loop, drawn in turn with the
/// ray-caster; both eyes against one and one; the ray-caster against one without what the scene does not use. At last, what
/// frames in hand feel while another scene is made. Writes render.json, render.csv, render.png and render.svg. See
/// docs/performance.md.
#[derive(Debug, Args)]
pub(crate) struct BenchRender {
    /// Scenes, or folders of scenes
    #[arg(long, num_args = 1.., default_value = "assets/scenes", value_name = "FILE")]
    pub(crate) scene: Vec<PathBuf>,
    /// Where results go
    #[arg(long, default_value = "out/bench-render", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Width and height of an eye's picture; may be given several times
    #[arg(long, default_value = "320x180", value_name = "WxH")]
    pub(crate) size: Vec<Size>,
    /// Only settings of this name, such as draft or 'balanced, no skipping'; may be given several times
    #[arg(long, value_name = "NAME")]
    pub(crate) setting: Vec<String>,
    /// Frames of each kind, in turn; fewer, but three, where they take long
    #[arg(long, default_value_t = 9, value_name = "N")]
    pub(crate) rounds: usize,
    /// Distance of the eyes in millimetres
    #[arg(long, default_value_t = 64.0, value_name = "MM")]
    pub(crate) eye_distance_mm: f64,
    /// Use the adapter whose name contains this
    #[arg(long, value_name = "NAME")]
    pub(crate) adapter: Option<String>,
    /// The results as JSON on standard output, instead of a table
    #[arg(long)]
    pub(crate) json: bool,
}

/// How cost grows with pixels, voxels, matter and headsets.
///
/// Draws phantoms of which the occupied part is known, varies one thing at a time and fits a power law to each curve; tells
/// what a volume of each size takes besides its frames: upload, memory to skip with, a change of transfer function; and how
/// long a volume takes from its file to its first frame. Writes scale.json, scale.png and scale.svg. See docs/performance.md.
#[derive(Debug, Args)]
pub(crate) struct BenchScale {
    /// Where results go
    #[arg(long, default_value = "out/bench-scale", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// The setting, such as draft or balanced
    #[arg(long, default_value = "balanced", value_name = "NAME")]
    pub(crate) setting: String,
    /// Sizes of an eye's picture; the second is held while other things are varied
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "160x90,320x180,640x360,1268x720",
        value_name = "WxH,..."
    )]
    pub(crate) sizes: Vec<Size>,
    /// Voxels along a side, of 16 bits; those that do not fit in the memory that is free are left out
    #[arg(long, value_delimiter = ',', default_value = "64,128,256,512", value_name = "N,...")]
    pub(crate) sides: Vec<u32>,
    /// Occupied parts of the volume
    #[arg(long, value_delimiter = ',', default_value = "0.01,0.03,0.1,0.3,1", value_name = "PART,...")]
    pub(crate) occupied: Vec<f64>,
    /// Headsets that watch one scene, 160x90 an eye
    #[arg(long, value_delimiter = ',', default_value = "1,2,4,8,16,32", value_name = "N,...")]
    pub(crate) sessions: Vec<usize>,
    /// Frames of each; fewer, but three, where they take long
    #[arg(long, default_value_t = 9, value_name = "N")]
    pub(crate) rounds: usize,
    /// Voxels along a side of a volume that is written, loaded and shown to its first frame; 0 for none
    #[arg(long, default_value_t = 512, value_name = "N")]
    pub(crate) start_up: u32,
    /// Use the adapter whose name contains this
    #[arg(long, value_name = "NAME")]
    pub(crate) adapter: Option<String>,
    /// The results as JSON on standard output, instead of a table
    #[arg(long)]
    pub(crate) json: bool,
}

/// Say what a volume is, or what volumes a scene shows and how they lie to each other.
#[derive(Debug, Args)]
pub(crate) struct Info {
    /// The volume: a file, or a folder of DICOM files; or a scene, whose name ends in .json
    pub(crate) path: PathBuf,
    #[command(flatten)]
    pub(crate) chosen: Chosen,
    /// Say also who the patient is
    #[arg(long)]
    pub(crate) identity: bool,
    /// As JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// Write a volume in another format.
#[derive(Debug, Args)]
pub(crate) struct Convert {
    /// The volume: a file, or a folder of DICOM files
    #[arg(value_name = "IN")]
    pub(crate) input: PathBuf,
    /// The file to write: .nii, .nii.gz, .nrrd, or .png with a .json beside it (slice atlas)
    #[arg(value_name = "OUT")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) chosen: Chosen,
    /// Voxels to keep along x, y and z, the last not included: 10:200,0:180,20:90; an empty side means the end
    #[arg(long, value_name = "X0:X1,Y0:Y1,Z0:Z1")]
    pub(crate) crop: Option<Crop>,
    /// The channel to write, where there are several
    #[arg(long, value_name = "NAME")]
    pub(crate) channel: Option<String>,
    /// Bits of a sample: keep, 8 or 16
    #[arg(long, default_value = "keep", value_name = "BITS")]
    pub(crate) bits: Bits,
    /// Lowest and highest value that 8 or 16 bits stand for; by default those of the channel
    #[arg(long, value_name = "LOW,HIGH", allow_hyphen_values = true, value_parser = window)]
    pub(crate) window: Option<[f64; 2]>,
    /// Replace a file that is there
    #[arg(long)]
    pub(crate) overwrite: bool,
    /// What was written, as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// Bits of a sample in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Bits {
    /// As they are
    Keep,
    /// 8 bits
    #[value(name = "8")]
    Eight,
    /// 16 bits
    #[value(name = "16")]
    Sixteen,
}

/// First voxel and the one after the last, along x, y and z; none where the side is the volume's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Crop(pub(crate) [[Option<u32>; 2]; 3]);

impl std::str::FromStr for Crop {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("'{text}' is no crop; expected X0:X1,Y0:Y1,Z0:Z1, such as 10:200,:,20:90");
        let side = |s: &str| match s.trim() {
            "" => Ok(None),
            number => number.parse().map(Some).map_err(|_| wrong()),
        };
        let axes: Vec<[Option<u32>; 2]> = text
            .split(',')
            .map(|axis| {
                let (first, end) = axis.split_once(':').ok_or_else(wrong)?;
                Ok([side(first)?, side(end)?])
            })
            .collect::<Result<_, String>>()?;
        axes.try_into().map(Self).map_err(|_| wrong())
    }
}

fn window(text: &str) -> Result<[f64; 2], String> {
    let wrong = || format!("'{text}' is no window; expected LOW,HIGH, such as -160,240");
    let (low, high) = text.split_once(',').ok_or_else(wrong)?;
    let number = |s: &str| s.trim().parse::<f64>().ok().filter(|n| n.is_finite()).ok_or_else(wrong);
    Ok([number(low)?, number(high)?])
}

/// Width and height in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Size(pub(crate) [u32; 2]);

impl std::str::FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("'{text}' is no size; expected WIDTHxHEIGHT, such as 640x360");
        let (width, height) = text.split_once(['x', 'X', '×']).ok_or_else(wrong)?;
        let side = |s: &str| s.trim().parse::<u32>().ok().filter(|&n| n > 0).ok_or_else(wrong);
        Ok(Self([side(width)?, side(height)?]))
    }
}

/// A part of full brightness, written as a number from 0 to 1 or as a fraction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Part(pub(crate) f64);

impl std::str::FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |s: &str| s.trim().parse::<f64>().ok();
        let value = match text.split_once('/') {
            Some((n, d)) => number(n).zip(number(d)).map(|(n, d)| n / d),
            None => number(text),
        };
        value.filter(|v| (0.0..=1.0).contains(v)).map(Self).ok_or_else(|| {
            format!("'{text}' is no part of full brightness; expected 0 to 1, such as 0.002 or 0.5/255")
        })
    }
}

/// A colour, RGB, each 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Color(pub(crate) [f64; 3]);

impl std::str::FromStr for Color {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Option<Vec<f64>> =
            text.split(',').map(|s| s.trim().parse().ok().filter(|v| (0.0..=1.0).contains(v))).collect();
        parts
            .and_then(|parts| parts.try_into().ok())
            .map(Self)
            .ok_or_else(|| format!("'{text}' is no colour; expected R,G,B, each 0 to 1, such as 0,0,0"))
    }
}

/// A name and a number: `step_voxels=1.5`.
fn tuned(text: &str) -> Result<(String, f64), String> {
    let (name, number) = text.split_once('=').ok_or_else(|| format!("'{text}': expected NAME=NUMBER"))?;
    let number = number.parse().map_err(|e| format!("'{number}' is no number: {e}"))?;
    Ok((name.to_owned(), number))
}

/// A number above 0.
fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|n| *n > 0.0 && n.is_finite());
    number.ok_or_else(|| format!("'{text}' is no number above 0"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory as _;

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }

    #[test]
    fn crops_and_windows_are_read() {
        assert_eq!("1:2,:,3:".parse(), Ok(Crop([[Some(1), Some(2)], [None, None], [Some(3), None]])));
        for wrong in ["1:2,3:4", "1:2,3:4,5:6,7:8", "a:2,:,:", "1,2,3", "-1:2,:,:"] {
            assert!(wrong.parse::<Crop>().is_err(), "{wrong}");
        }
        assert_eq!(window("-160,240"), Ok([-160.0, 240.0]));
        assert!(window("1").is_err() && window("nan,1").is_err());
    }

    #[test]
    fn sizes_are_read() {
        assert_eq!("640x360".parse(), Ok(Size([640, 360])));
        assert!("640".parse::<Size>().is_err());
        assert!("0x5".parse::<Size>().is_err());
    }

    #[test]
    fn parts_of_full_brightness_are_read() {
        assert_eq!("0.25".parse(), Ok(Part(0.25)));
        assert_eq!("51/255".parse(), Ok(Part(0.2)));
        for wrong in ["", "1.5", "-1", "NaN", "1/0", "0/0", "1/2/3", "x"] {
            assert!(wrong.parse::<Part>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn colours_are_read() {
        assert_eq!("0, 0.5,1".parse(), Ok(Color([0.0, 0.5, 1.0])));
        for wrong in ["", "1,1", "1,1,1,1", "0,0,2", "a,b,c"] {
            assert!(wrong.parse::<Color>().is_err(), "{wrong}");
        }
    }
}
