//! What a run ran on.

use serde::{Deserialize, Serialize};

/// The machine that ran the headsets and wrote the report.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// Operating system with its version, such as `Debian GNU/Linux 12`.
    pub os: String,
    /// The processor's name; `None` if not known.
    pub cpu: Option<String>,
    /// Logical processors that the program may use.
    pub cores: u32,
    /// Main memory in bytes; `None` if not known.
    pub memory_bytes: Option<u64>,
    /// The adapter that rendered, if it is in this machine; `None` if not known.
    pub adapter: Option<String>,
}

/// The server that rendered, as far as the headsets know it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Server {
    /// Its name for itself.
    pub name: String,
    /// Host and port that the headsets connected to.
    pub address: String,
    /// Protocol that was spoken, such as `holocast/1`.
    pub protocol: String,
    /// RFC 6381 name of the codec, such as `avc1.42C020`; `None` if not known.
    pub codec: Option<String>,
    /// The adapter that rendered; `None` if not known.
    pub adapter: Option<String>,
    /// The volume that was shown; `None` if not known.
    pub volume: Option<Volume>,
}

/// A volume, for people.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Volume {
    /// The name that it was loaded under.
    pub name: String,
    /// Samples along its three axes.
    pub dimensions: [u32; 3],
    /// Distance of samples along its three axes, in millimetres; `None` if not known.
    pub spacing_mm: Option<[f64; 3]>,
}

/// What a process used of its machine.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Process {
    /// What the process is: `server`, `headsets`, or both if they share one.
    pub name: String,
    /// Processor time in the run, all threads, user and system, in seconds; `None` if not known.
    pub cpu_secs: Option<f64>,
    /// Resident memory at the run's end, in bytes; `None` if not known.
    pub rss_bytes: Option<u64>,
    /// The most resident memory so far, in bytes; `None` if not known.
    pub rss_peak_bytes: Option<u64>,
}
