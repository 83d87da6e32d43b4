//! What can go wrong with a device.

/// Why no device could be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// There is no Vulkan driver at all.
    #[error(
        "no Vulkan adapter found. Install a driver: the GPU vendor's, or Mesa's software driver \
         (Debian/Ubuntu: apt-get install mesa-vulkan-drivers libvulkan1)"
    )]
    NoAdapter,
    /// None of the adapters has the name asked for.
    #[error("no adapter whose name contains '{wanted}'; there are: {available}")]
    NoSuchAdapter {
        /// What was asked for.
        wanted: String,
        /// The names there are.
        available: String,
    },
    /// The adapter lacks something that holocast cannot do without.
    #[error("adapter '{adapter}' lacks {missing}")]
    Lacks {
        /// The adapter's name.
        adapter: String,
        /// What it lacks.
        missing: String,
    },
    /// The driver refused.
    #[error("adapter '{adapter}' could not be opened: {reason}")]
    Refused {
        /// The adapter's name.
        adapter: String,
        /// The driver's words.
        reason: String,
    },
}

/// Why something could not be put on the device or drawn.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The volume has more voxels along an axis than a texture may have.
    #[error("the volume has {dims:?} voxels, the device allows {max} along each axis of a 3-D texture")]
    VolumeTooLarge {
        /// Voxels along x, y, z.
        dims: [u32; 3],
        /// The device's limit.
        max: u32,
    },
    /// Samples are NaN or infinite, which a shader may not be given; a loader replaces them.
    #[error("channel '{channel}' has {count} samples that are not finite: replace them first")]
    NotFinite {
        /// The channel's name.
        channel: String,
        /// How many.
        count: usize,
    },
    /// A channel holds more labels than can be told apart.
    #[error("channel '{channel}' holds {found} labels, at most {max} can be told apart")]
    TooManyLabels {
        /// The channel's name.
        channel: String,
        /// How many.
        found: usize,
        /// The most.
        max: usize,
    },
    /// The scene takes measured values for labels, or labels for measured values.
    #[error("the scene was resolved for another volume: channel '{channel}' {}", if *labels { "holds labels" } else { "holds measured values" })]
    Kind {
        /// The channel's name.
        channel: String,
        /// Whether the channel holds labels.
        labels: bool,
    },
    /// The picture has more pixels along a side than a texture may have.
    #[error("one eye's picture has {size_px:?} pixels, the device allows {max} along each side")]
    PictureTooLarge {
        /// Pixels across and down.
        size_px: [u32; 2],
        /// The device's limit.
        max: u32,
    },
    /// A buffer would be larger than the device allows.
    #[error("{what} needs {bytes} bytes, the device allows {max} in one buffer")]
    BufferTooLarge {
        /// What the buffer is for.
        what: &'static str,
        /// Bytes needed.
        bytes: u64,
        /// The device's limit.
        max: u64,
    },
    /// The device ran out of memory or refused something.
    #[error("the device refused {what}: {reason}")]
    Device {
        /// What was asked of it.
        what: &'static str,
        /// Its words.
        reason: String,
    },
    /// The device left the shader's loops before some rays were at their ends: there is too much on their way.
    #[error(
        "{pixels} pixels are not whole: the device left their rays early. Mesa's software driver does so after 65535 \
         rounds of a shader's loops; a simpler transfer function or the level balanced takes fewer"
    )]
    Unfinished {
        /// How many.
        pixels: usize,
    },
    /// All slots of the read-back ring are in use.
    #[error("all {slots} slots of the read-back ring are in use; finish a frame before the next one")]
    RingFull {
        /// Slots there are.
        slots: usize,
    },
    /// The scene shows a volume that is not on the device.
    #[error("volume {volume} is not on the device, which holds {volumes}")]
    NoSuchVolume {
        /// The volume asked for, from 0.
        volume: usize,
        /// Volumes there are.
        volumes: usize,
    },
    /// The scene shows more volumes than the shaders take.
    #[error("the scene shows {found} volumes, at most {max} are drawn together")]
    TooManyVolumes {
        /// Volumes that are shown.
        found: usize,
        /// Volumes that can be.
        max: usize,
    },
    /// A further volume's registration takes its grid out of what a grid may be.
    #[error("a further volume in register with the first: {0}")]
    Grid(#[from] volume::GridError),
    /// The scene shows a channel that is not on the device.
    #[error("channel {channel} is not on the device, which holds {channels}")]
    NoSuchChannel {
        /// The channel asked for, from 0.
        channel: usize,
        /// Channels there are.
        channels: usize,
    },
}
