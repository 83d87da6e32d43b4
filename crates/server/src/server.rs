//! The server: what its threads and tasks share, and its life.

use crate::clock::Clock;
use crate::connection;
use crate::encoding::{EncoderPool, StopOnPanic};
use crate::pairing::Guesses;
use crate::playing;
use crate::quality::{QualityController, Rung};
use crate::render_loop::RenderLoop;
use crate::room::{Room, SceneChangeError, Volumes};
use crate::seat::{Seat, SeatSnapshot, locked};
use crate::settings::Settings;
use render::{FrameRenderer, Gpu, RenderError};
use scene::SceneFile;
use session::{ServerSession, ServerSettings, ServerTime};
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::sync::watch;
use tokio::task::JoinSet;
use transport::{BindError, Connection, Fingerprint, Identity, ServerEndpoint};
use wire::CloseCode;

/// Frames that may wait for an encoder, beyond those being encoded.
const WAITING_FRAMES: usize = 2;
/// Connections that may be there without having said hello, beside the headsets.
const MOST_WITHOUT_HELLO: usize = 64;
/// Longest scene that is told to headsets that did not ask for it, in bytes: a few of them fit a slow peer's backlog.
const LONGEST_TOLD_SCENE: usize = 16 << 10;
/// How long sessions may take to say goodbye when the server stops.
const GOODBYE: Duration = Duration::from_secs(2);
/// How often it is looked whether the thread `play` has ended.
const LOOK: Duration = Duration::from_millis(2);

/// Why a server does not start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// It cannot listen.
    #[error(transparent)]
    Bind(#[from] BindError),
    /// The scene cannot be shown.
    #[error(transparent)]
    Scene(#[from] SceneChangeError),
    /// The device has no room.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A thread or the socket's address could not be had.
    #[error("the system refused {what}: {source}")]
    System {
        /// What was asked of it.
        what: &'static str,
        /// What it said.
        source: std::io::Error,
    },
}

/// Tells a waiting thread that there may be something to do.
#[derive(Debug, Default)]
pub(crate) struct Wishes {
    there: Mutex<bool>,
    changed: Condvar,
}

impl Wishes {
    pub(crate) fn wake(&self) {
        *locked(&self.there) = true;
        self.changed.notify_one();
    }

    /// Waits for a wake since the last wait, at most `longest`.
    pub(crate) fn wait(&self, longest: Duration) {
        let there = locked(&self.there);
        let waited = self.changed.wait_timeout_while(there, longest, |there| !*there);
        let (mut there, _) = waited.unwrap_or_else(std::sync::PoisonError::into_inner);
        *there = false;
    }
}

/// What all threads and tasks of a server share.
#[derive(Debug)]
pub(crate) struct Shared {
    pub(crate) settings: Settings,
    pub(crate) clock: Clock,
    pub(crate) room: Room,
    pub(crate) wishes: Wishes,
    /// Tells the thread `play` of another scene and of headsets that come.
    pub(crate) played: Wishes,
    seats: Mutex<Arc<Vec<Arc<Seat>>>>,
    stopping: AtomicBool,
    next_session: AtomicU64,
    pub(crate) guesses: Mutex<Guesses>,
    /// One for all headsets: they share the device, and what is too much for it is too much for each.
    quality: Mutex<QualityController>,
    /// Tells the accepting task to end.
    stop: watch::Sender<bool>,
}

impl Shared {
    pub(crate) fn new(settings: Settings, clock: Clock, room: Room) -> Arc<Self> {
        Arc::new(Self {
            clock,
            room,
            wishes: Wishes::default(),
            played: Wishes::default(),
            seats: Mutex::default(),
            stopping: AtomicBool::new(false),
            next_session: AtomicU64::new(1),
            guesses: Mutex::default(),
            quality: Mutex::default(),
            stop: watch::Sender::new(false),
            settings,
        })
    }

    /// Frames of the read-back ring: those on the device, those being encoded, and those that wait.
    pub(crate) fn slots(&self) -> usize {
        self.settings.device_queue + self.settings.encoder_threads + WAITING_FRAMES
    }

    /// The seats of this moment.
    pub(crate) fn seats(&self) -> Arc<Vec<Arc<Seat>>> {
        locked(&self.seats).clone()
    }

    /// Whether there is somebody to see.
    pub(crate) fn has_headsets(&self) -> bool {
        self.seats().iter().any(|seat| seat.stream().is_some())
    }

    pub(crate) fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Acquire)
    }

    pub(crate) fn stop(&self) {
        self.stopping.store(true, Ordering::Release);
        self.stop.send_replace(true);
        self.wishes.wake();
        self.played.wake();
    }

    /// Shows another scene; see [`Room::change`].
    pub(crate) fn change_scene(
        &self,
        json: &str,
        announce: impl FnOnce(u32),
    ) -> Result<u32, SceneChangeError> {
        let changed = self.room.change(json, announce);
        self.played.wake();
        changed
    }

    /// What a frame may cost now, of a scene that is gone through in steps or is not.
    pub(crate) fn rung(&self, takes_steps: bool) -> Rung {
        let mut quality = locked(&self.quality);
        quality.draws(self.clock.now(), takes_steps);
        quality.rung()
    }

    /// Judges the load of all headsets together.
    pub(crate) fn judge(&self, now: ServerTime) {
        if !self.settings.adapt_quality {
            return;
        }
        let seats = self.seats();
        let streams = || seats.iter().filter_map(|s| s.stream());
        let load = streams().map(|s| s.device_share(now)).sum();
        let mut quality = locked(&self.quality);
        let before = quality.rung().cost();
        if quality.update(now, load) {
            let times = quality.rung().cost() / before;
            streams().for_each(|s| s.expect_cost(times));
        }
    }

    pub(crate) fn take_seat(&self, peer: SocketAddr) -> Arc<Seat> {
        let id = self.next_session.fetch_add(1, Ordering::Relaxed);
        let settings = ServerSettings {
            session_id: id,
            server_name: self.settings.server_name.clone(),
            pairing_code: self.settings.pairing_code.clone(),
            scene_revision: self.room.shown().revision,
            prediction: self.settings.prediction,
            ..ServerSettings::default()
        };
        let seat = Arc::new(Seat::new(id, peer, ServerSession::new(self.clock.now(), settings)));
        let mut seats = locked(&self.seats);
        let mut now = seats.to_vec();
        now.push(seat.clone());
        *seats = Arc::new(now);
        drop(seats);
        // A scene that was changed while the seat was not yet among the others.
        seat.session().scene_changed(None, self.room.shown().revision, None);
        seat
    }

    fn leave(&self, id: u64) {
        let mut seats = locked(&self.seats);
        *seats = Arc::new(seats.iter().filter(|s| s.id != id).cloned().collect());
    }
}

/// A running server. Dropping it stops it without goodbyes; [`Server::shutdown`] says them.
#[derive(Debug)]
pub struct Server {
    shared: Arc<Shared>,
    address: SocketAddr,
    fingerprint: Fingerprint,
    /// The thread `render`.
    render: Option<JoinHandle<()>>,
    /// The thread `play`, where there is a series.
    play: Option<JoinHandle<()>>,
    accepting: Option<tokio::task::JoinHandle<()>>,
}

impl Server {
    /// Starts serving volumes. To be called inside of a tokio runtime.
    ///
    /// # Errors
    /// If it cannot listen, the scene cannot be shown, or the device has no room.
    pub fn start(
        settings: Settings,
        identity: &Identity,
        gpu: &Arc<Gpu>,
        volumes: Volumes,
        scene: &SceneFile,
    ) -> Result<Self, StartError> {
        let clock = Clock::start();
        let series = volumes.series.clone();
        let room = Room::new(gpu, volumes, settings.quality, scene)?;
        let endpoint = ServerEndpoint::bind(settings.listen, identity, &[wire::ALPN], &settings.transport)?;
        let address =
            endpoint.local_addr().map_err(|source| StartError::System { what: "the address", source })?;
        let shared = Shared::new(settings, clock, room);
        let slots = shared.slots();
        let ring = FrameRenderer::new(gpu, slots)?;
        let thread = |source| StartError::System { what: "a thread", source };
        let encoders = EncoderPool::start(&shared, shared.settings.encoder_threads, slots).map_err(thread)?;
        let render_loop = RenderLoop::new(shared.clone(), ring, encoders);
        let render = spawn("render", &shared, move |_| render_loop.run()).map_err(thread)?;
        let play = series
            .map(|series| spawn("play", &shared, move |shared| playing::run(shared, &series)))
            .transpose()
            .map_err(|source| {
                // The thread `render` runs already.
                shared.stop();
                thread(source)
            })?;
        let accepting = tokio::spawn(accept(shared.clone(), endpoint));
        let fingerprint = identity.fingerprint();
        Ok(Self { shared, address, fingerprint, render: Some(render), play, accepting: Some(accepting) })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// What headsets pin.
    #[must_use]
    pub fn fingerprint(&self) -> Fingerprint {
        self.fingerprint
    }

    /// The headsets of this moment.
    #[must_use]
    pub fn seats(&self) -> Vec<SeatSnapshot> {
        self.shared.seats().iter().map(|s| s.snapshot()).collect()
    }

    /// Shows another scene to all headsets; returns its revision.
    ///
    /// # Errors
    /// If it is not valid for this volume or the device has no room. The old scene stays.
    pub fn change_scene(&self, json: &str) -> Result<u32, SceneChangeError> {
        self.shared.change_scene(json, |revision| {
            for seat in self.shared.seats().iter() {
                seat.session().scene_changed(None, revision, told(json));
                seat.wake.notify_one();
            }
        })
    }

    /// Waits until the server stops by itself, which it does only if the device fails.
    pub async fn failed(&self) {
        let mut stop = self.shared.stop.subscribe();
        // The sender lives as long as this server.
        let _ = stop.wait_for(|stopping| *stopping).await;
    }

    /// Says goodbye to all headsets, closes the port and ends all threads. A step that is still being loaded after the time
    /// for goodbyes is not waited for: its thread is let go, and ends when it is there.
    pub async fn shutdown(mut self) {
        self.shared.stop();
        if let Some(accepting) = self.accepting.take() {
            let _ = accepting.await;
        }
        if let Some(render) = self.render.take() {
            // It is in a call of the device or asleep for some milliseconds.
            let _ = tokio::task::spawn_blocking(move || render.join()).await;
        }
        if let Some(play) = self.play.take() {
            // Looked at and not joined: who waits in a join would hold up the end of the runtime.
            let ended = async {
                while !play.is_finished() {
                    tokio::time::sleep(LOOK).await;
                }
            };
            if tokio::time::timeout(GOODBYE, ended).await.is_err() {
                tracing::warn!("a step is still being loaded; it is not waited for");
            }
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.shared.stop();
    }
}

/// A thread whose panic stops the server.
fn spawn(
    name: &str,
    shared: &Arc<Shared>,
    run: impl FnOnce(&Shared) + Send + 'static,
) -> std::io::Result<JoinHandle<()>> {
    let shared = shared.clone();
    std::thread::Builder::new().name(name.into()).spawn(move || {
        let _stops = StopOnPanic(&shared);
        run(&shared);
    })
}

/// A scene's text for those who did not ask for it: left out if it is long.
pub(crate) fn told(json: &str) -> Option<&str> {
    (json.len() <= LONGEST_TOLD_SCENE).then_some(json)
}

/// Accepts headsets until the server stops, then lets them say goodbye.
async fn accept(shared: Arc<Shared>, endpoint: ServerEndpoint) {
    let mut tasks = JoinSet::new();
    let mut stop = shared.stop.subscribe();
    loop {
        tokio::select! {
            _ = stop.wait_for(|stopping| *stopping) => break,
            connection = endpoint.accept() => match connection {
                Some(connection) => admit(&shared, connection, &mut tasks),
                None => break,
            },
            // Ended tasks are taken out as they end.
            Some(_) = tasks.join_next(), if !tasks.is_empty() => {}
        }
    }
    for seat in shared.seats().iter() {
        connection::end(seat, shared.clock.now());
    }
    let all = async { while tasks.join_next().await.is_some() {} };
    let _ = tokio::time::timeout(GOODBYE, all).await;
    endpoint.close(u64::from(CloseCode::ShuttingDown.value()), "the server shuts down").await;
}

fn admit(shared: &Arc<Shared>, connection: Connection, tasks: &mut JoinSet<()>) {
    let shared = shared.clone();
    let max = shared.settings.max_headsets;
    // Who has not said hello yet takes no headset's place, but there is a bound for these too.
    if shared.seats().len() >= max + MOST_WITHOUT_HELLO {
        tracing::info!(peer = %connection.remote_address(), "refused: {max} headsets are connected");
        tasks.spawn(async move {
            let reason = format!("{max} headsets are connected, no more are admitted");
            connection.close(u64::from(CloseCode::TooManyHeadsets.value()), &reason).await;
        });
        return;
    }
    let seat = shared.take_seat(connection.remote_address());
    tasks.spawn(async move {
        let leaving = Leaving { shared: shared.clone(), id: seat.id };
        connection::serve(shared, connection, seat).await;
        drop(leaving);
    });
}

/// Frees a seat however its task ends.
struct Leaving {
    shared: Arc<Shared>,
    id: u64,
}

impl Drop for Leaving {
    fn drop(&mut self) {
        self.shared.leave(self.id);
        self.shared.wishes.wake();
    }
}
