//! A server in this process, on the GPU, on a free port of loopback.

use headset::{DecodePool, DeviceModel, HeadsetSettings};
use render::{
    DepthGridSize, Gpu, Placed, SceneOnDevice, SharedVolume, StereoPlan, StereoRequest, Still, StillRenderer,
    VolumeOnDevice,
};
use scene::{FurtherFacts, SceneFile, VolumeFacts, VolumeSource};
use server::{SeatSnapshot, Series, Server, Settings, StartError, Volumes};
use session::Device;
use spatial::StereoView;
use std::net::{Ipv4Addr, SocketAddr};
use std::num::NonZero;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use transport::{Fingerprint, Identity};
use volume::Volume;

/// Pixels of one eye: few, as a program draws them.
pub const SIZE_PX: [u32; 2] = [96, 64];
/// Frames a second that [`device`] asks for.
pub const REFRESH_HZ: f32 = 30.0;

/// The device of all tests of a process.
pub fn gpu() -> &'static Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| Arc::new(Gpu::open(None).unwrap_or_else(|error| panic!("{error}"))))
}

/// A headset of [`SIZE_PX`] and [`REFRESH_HZ`] that takes whatever bit rate it can get.
#[must_use]
pub fn device(name: &str) -> Device {
    let [width, height] = SIZE_PX;
    let device = DeviceModel::Pixels { width, height }.device(REFRESH_HZ).expect("a field of view");
    Device { name: name.to_owned(), max_bitrate_bps: 60_000_000, ..device }
}

/// A server on a free port of loopback.
#[must_use]
pub fn settings() -> Settings {
    Settings::new((Ipv4Addr::LOCALHOST, 0).into())
}

/// A server with what it shows, alone in its process while it lives.
#[derive(Debug)]
pub struct TestServer {
    /// The server itself.
    pub server: Server,
    /// What it shows.
    pub volume: Volume,
    /// What it may show beside that.
    pub others: Vec<Volume>,
    /// What it was told.
    pub settings: Settings,
    volumes: Volumes,
    pool: DecodePool,
    /// Held while it lives.
    _alone: MutexGuard<'static, ()>,
}

impl TestServer {
    /// Starts to serve a volume. To be called inside of a tokio runtime.
    #[must_use]
    pub fn start(volume: Volume, scene_json: &str, settings: Settings) -> Self {
        Self::start_beside(volume, Vec::new(), scene_json, settings)
    }

    /// The same with a series in time, of which `first` is a step.
    #[must_use]
    pub fn start_series(first: Volume, series: Series, scene_json: &str, settings: Settings) -> Self {
        Self::start_with(first, Vec::new(), Some(series), scene_json, settings)
    }

    /// The same with volumes beside it, which scenes call `1`, `2`, ….
    #[must_use]
    pub fn start_beside(volume: Volume, others: Vec<Volume>, scene_json: &str, settings: Settings) -> Self {
        Self::start_with(volume, others, None, scene_json, settings)
    }

    fn start_with(
        volume: Volume,
        others: Vec<Volume>,
        series: Option<Series>,
        scene_json: &str,
        settings: Settings,
    ) -> Self {
        static ALONE: Mutex<()> = Mutex::new(());
        // A test that has failed leaves nothing behind that this guards.
        let alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
        let upload = |volume: &Volume| {
            Arc::new(VolumeOnDevice::upload(gpu(), volume, |_| {}).unwrap_or_else(|e| panic!("{e}")))
        };
        let called = |(i, volume): (usize, &Volume)| FurtherFacts {
            source: VolumeSource { path: (i + 1).to_string().into(), series: None, kind: None },
            facts: VolumeFacts::of(volume),
        };
        let on_device = || std::iter::once(&volume).chain(&others).map(upload).collect();
        let volumes = Volumes {
            on_device: on_device(),
            facts: VolumeFacts::of(&volume),
            others: others.iter().enumerate().map(called).collect(),
            series,
        };
        let scene = SceneFile::from_json(scene_json).unwrap_or_else(|e| panic!("{e}"));
        let identity = Identity::ephemeral().unwrap_or_else(|e| panic!("{e}"));
        // The steps of a series are the server's own: it waits until they are gone.
        let served = match volumes.series {
            Some(_) => Volumes { on_device: on_device(), ..volumes.clone() },
            None => volumes.clone(),
        };
        let server = Server::start(settings.clone(), &identity, gpu(), served, &scene)
            .unwrap_or_else(|e| panic!("{e}"));
        let pool = DecodePool::new(NonZero::<usize>::MIN).expect("a thread");
        Self { server, volume, others, settings, volumes, pool, _alone: alone }
    }

    /// Tries to start another server of the same volume beside this one.
    ///
    /// # Errors
    /// As [`Server::start`].
    pub fn another(&self, settings: Settings) -> Result<Server, StartError> {
        let identity = Identity::ephemeral().unwrap_or_else(|e| panic!("{e}"));
        Server::start(settings, &identity, gpu(), self.volumes.clone(), &SceneFile::default())
    }

    /// The session of that number, if it has a seat.
    #[must_use]
    pub fn seat(&self, session: u64) -> Option<SeatSnapshot> {
        self.server.seats().into_iter().find(|seat| seat.session == session)
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.server.address()
    }

    /// What headsets pin.
    #[must_use]
    pub fn fingerprint(&self) -> Fingerprint {
        self.server.fingerprint()
    }

    /// Threads that decode for the headsets of this test.
    #[must_use]
    pub fn pool(&self) -> &DecodePool {
        &self.pool
    }

    /// For a headset that comes here.
    #[must_use]
    pub fn headset(&self, name: &str) -> HeadsetSettings {
        HeadsetSettings::new(self.address().to_string(), self.fingerprint(), device(name))
    }

    /// The renderer's own picture of a scene, with the server's quality.
    #[must_use]
    pub fn still(&self, scene_json: &str, view: &StereoView) -> Still {
        self.still_of(&self.volumes.on_device, scene_json, view)
    }

    /// The same of a step of a series, in colours that the room's first step has filled.
    #[must_use]
    pub fn still_of_step(&self, step: &Volume, scene_json: &str, view: &StereoView) -> Still {
        let step = VolumeOnDevice::upload(gpu(), step, |_| {}).unwrap_or_else(|e| panic!("{e}"));
        self.still_of(&[Arc::new(step)], scene_json, view)
    }

    fn still_of(&self, volumes: &[SharedVolume], scene_json: &str, view: &StereoView) -> Still {
        let scene = self.scene(scene_json);
        let on_device = SceneOnDevice::of_several(gpu(), volumes, &scene).unwrap_or_else(|e| panic!("{e}"));
        let request = StereoRequest {
            eyes: &view.eyes,
            placed: Placed::in_room(&scene.placement, on_device.grid()),
            eye_size_px: SIZE_PX,
            quality: self.settings.quality,
            step_mm: None,
            depth_grid: DepthGridSize::default(),
        };
        let plan = StereoPlan::new(&request, on_device.grid(), on_device.numbers())
            .unwrap_or_else(|e| panic!("{e}"));
        StillRenderer::new(gpu()).render(&on_device, &plan).unwrap_or_else(|e| panic!("{e}"))
    }

    /// A scene with its gaps filled from this volume.
    #[must_use]
    pub fn scene(&self, scene_json: &str) -> scene::Scene {
        SceneFile::from_json(scene_json)
            .and_then(|file| file.resolve_among(&self.volumes.facts, &self.volumes.others))
            .unwrap_or_else(|e| panic!("{e}"))
    }

    /// Waits until every seat is free.
    pub async fn is_empty(&self) {
        crate::until("every seat is free", || self.server.seats().is_empty()).await;
    }

    /// Ends it in order.
    pub async fn shutdown(self) {
        crate::within("the server to shut down", self.server.shutdown()).await;
    }
}
