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
    /// Draw a still picture of a scene, without a network
    Render(Render),
    /// Say what a volume is: dimensions, spacing, orientation, type, range, histogram
    Info(Info),
    /// Name the graphics adapters of this machine
    Adapters {
        /// As JSON
        #[arg(long)]
        json: bool,
    },
}

/// Serve a volume to headsets.
#[derive(Debug, Args)]
pub(crate) struct Serve {
    /// The volume; by default the one that the scene names, relative to the scene's file
    #[arg(long, value_name = "FILE")]
    pub(crate) volume: Option<PathBuf>,
    /// The scene to begin with (JSON, see docs/scene-format.md); without one, the volume in default colours
    #[arg(long, value_name = "FILE")]
    pub(crate) scene: Option<PathBuf>,
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
    /// Where it listens, what headsets pin and what it shows, as one line of JSON on standard output
    #[arg(long)]
    pub(crate) json: bool,
}

/// Draw a still picture.
#[derive(Debug, Args)]
pub(crate) struct Render {
    /// The scene (JSON, see docs/scene-format.md); without one, the volume in default colours
    #[arg(long, value_name = "FILE")]
    pub(crate) scene: Option<PathBuf>,
    /// The volume; by default the one that the scene names, relative to the scene's file
    #[arg(long, value_name = "FILE")]
    pub(crate) volume: Option<PathBuf>,
    /// What the picture may cost: draft, balanced, fine, exact
    #[arg(long, default_value = "fine", value_name = "LEVEL")]
    pub(crate) quality: String,
    /// The picture to write (PNG)
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,
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

/// Say what a volume is.
#[derive(Debug, Args)]
pub(crate) struct Info {
    /// The volume's file
    pub(crate) path: PathBuf,
    /// As JSON
    #[arg(long)]
    pub(crate) json: bool,
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

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory as _;

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }

    #[test]
    fn sizes_are_read() {
        assert_eq!("640x360".parse(), Ok(Size([640, 360])));
        assert!("640".parse::<Size>().is_err());
        assert!("0x5".parse::<Size>().is_err());
    }
}
