//! A connection's task: drives one session.

use crate::seat::{Seat, locked};
use crate::server::{Shared, told};
use session::{Device, ServerEvent, ServerSession, ServerTime, ServerTransmit};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use transport::{Connection, Event, SendControlError, SendStreamError};
use wire::CloseCode;

/// Scenes of one headset that may be in the making: each holds a thread.
const MOST_SCENES_IN_MAKING: usize = 2;
/// Shortest wait for a timer, so that one that is always due cannot spin.
const SHORTEST_WAIT: Duration = Duration::from_micros(500);

/// Serves one headset to its end.
pub(crate) async fn serve(shared: Arc<Shared>, mut connection: Connection, seat: Arc<Seat>) {
    loop {
        let due = {
            let mut session = seat.session();
            handle_events(&shared, &seat, &mut session);
            session.poll_timeout()
        };
        if let Some((code, reason)) = send_all(&shared, &connection, &seat) {
            handle_events(&shared, &seat, &mut seat.session());
            connection.close(u64::from(code.value()), &reason).await;
            return;
        }
        if seat.session().is_closed() {
            // The peer has ended the connection: nobody is left to tell anything.
            return;
        }
        let now = shared.clock.now();
        if seat.session().frame_request(now).is_some() {
            shared.wishes.wake();
        }
        let due = due.unwrap_or(now).max(now + SHORTEST_WAIT);
        tokio::select! {
            event = connection.next_event() => handle_input(&shared, &seat, event),
            () = seat.wake.notified() => {}
            () = tokio::time::sleep_until(shared.clock.instant(due).into()) => {
                seat.session().handle_timeout(shared.clock.now());
            }
        }
    }
}

fn handle_input(shared: &Shared, seat: &Seat, event: Event) {
    let now = shared.clock.now();
    let mut session = seat.session();
    match event {
        Event::Control(bytes) if session.awaits_hello() => {
            hear_hello(shared, seat, &mut session, now, &bytes);
        }
        Event::Control(bytes) => session.handle_control(now, &bytes),
        Event::Datagram(bytes) => session.handle_datagram(now, &bytes),
        Event::Closed { by_peer, code, reason } => {
            // A code that this version does not know is some trouble of the peer's; none at all is the network's.
            let code = code.filter(|_| by_peer);
            let code = code.map(|c| CloseCode::from_value(c).unwrap_or(CloseCode::Internal));
            session.handle_disconnect(now, code, &reason);
        }
        // A headset opens no streams but the control stream; the transport's limits refuse them.
        Event::Stream { .. } | Event::StreamReset { .. } | Event::StreamTooLarge { .. } => {
            session.close(now, CloseCode::BadMessage, "a stream beside the control stream, expected none");
        }
    }
}

/// Hears a hello, unless its sender has guessed too many pairing codes. The count is held while the code is compared, so
/// that who guesses on many connections at once is counted too.
fn hear_hello(shared: &Shared, seat: &Seat, session: &mut ServerSession, now: ServerTime, bytes: &[u8]) {
    if shared.settings.pairing_code.is_none() {
        return session.handle_control(now, bytes);
    }
    let from = seat.peer.ip();
    let mut guesses = locked(&shared.guesses);
    if let Some(wait) = guesses.wait(from, now) {
        let secs = wait.as_secs() + 1;
        tracing::warn!(session = seat.id, peer = %seat.peer, "too many wrong pairing codes, none is heard for {secs} s");
        let reason =
            format!("too many wrong pairing codes came from your address, the next is heard in {secs} s");
        return session.close(now, CloseCode::NotPaired, &reason);
    }
    session.handle_control(now, bytes);
    if session.has_guessed_wrong() {
        guesses.wrong(from, now);
    }
}

fn handle_events(shared: &Arc<Shared>, seat: &Arc<Seat>, session: &mut ServerSession) {
    while let Some(event) = session.poll_event() {
        match event {
            ServerEvent::Connected { device } => open_stream(shared.clone(), seat.clone(), device),
            ServerEvent::SceneRequested { request_id, scene_json } => {
                change_scene(shared.clone(), seat.clone(), session, (request_id, scene_json));
            }
            ServerEvent::KeyFrameNeeded => {}
            ServerEvent::ClientStatistics(statistics) => {
                tracing::debug!(session = seat.id, "{statistics:?}");
            }
            ServerEvent::Disconnected(end) => {
                tracing::info!(
                    session = seat.id, peer = %seat.peer,
                    "headset gone, ended by {:?}: {:?}, {}", end.by, end.code, end.reason
                );
            }
        }
    }
}

/// Makes the encoder beside everything else, then welcomes the headset.
fn open_stream(shared: Arc<Shared>, seat: Arc<Seat>, device: Device) {
    tokio::task::spawn_blocking(move || {
        let max = shared.settings.max_headsets;
        let headsets = shared.seats().iter().filter(|s| s.stream().is_some()).count();
        let opened = if headsets < max {
            seat.open_stream(&device, shared.settings.bits_per_pixel)
                .map_err(|error| (CloseCode::BadDevice, error.to_string()))
        } else {
            let reason = format!("{max} headsets are connected, no more are admitted");
            Err((CloseCode::TooManyHeadsets, reason))
        };
        let now = shared.clock.now();
        match opened {
            Ok(terms) => {
                tracing::info!(
                    session = seat.id, peer = %seat.peer, device = %device.name,
                    "headset connected: {}x{} at {} Hz, {:.1} Mbit/s",
                    terms.width_px, terms.height_px, terms.refresh_hz, f64::from(terms.bitrate_bps) / 1e6
                );
                seat.session().welcome(now, &terms);
                shared.played.wake();
            }
            Err((code, reason)) => seat.session().close(now, code, &reason),
        }
        seat.wake.notify_one();
    });
}

/// Makes the scene beside everything else, then tells all headsets.
fn change_scene(shared: Arc<Shared>, seat: Arc<Seat>, session: &mut ServerSession, request: (u32, String)) {
    let (request_id, scene_json) = request;
    if seat.scenes_in_making.fetch_add(1, Ordering::AcqRel) >= MOST_SCENES_IN_MAKING {
        seat.scenes_in_making.fetch_sub(1, Ordering::AcqRel);
        let reason = format!("{MOST_SCENES_IN_MAKING} scenes are being made for this headset, wait for them");
        return session.scene_refused(request_id, &reason);
    }
    tokio::task::spawn_blocking(move || {
        let changed = shared.change_scene(&scene_json, |revision| {
            tracing::info!(session = seat.id, revision, "scene changed");
            for other in shared.seats().iter() {
                let asked = (other.id == seat.id).then_some(request_id);
                other.session().scene_changed(asked, revision, told(&scene_json));
                other.wake.notify_one();
            }
        });
        if let Err(error) = changed {
            tracing::info!(session = seat.id, "scene refused: {error}");
            seat.session().scene_refused(request_id, &error.to_string());
            seat.wake.notify_one();
        }
        seat.scenes_in_making.fetch_sub(1, Ordering::AcqRel);
    });
}

/// Sends what the session wants sent; returns code and reason if the connection is to be closed.
fn send_all(shared: &Shared, connection: &Connection, seat: &Seat) -> Option<(CloseCode, String)> {
    loop {
        let transmit = seat.session().poll_transmit(shared.clock.now())?;
        match transmit {
            ServerTransmit::Control(bytes) => {
                match connection.send_control(bytes) {
                    // The end that the connection is about to tell says who ended it and why.
                    Ok(()) | Err(SendControlError::Closed) => {}
                    Err(error) => {
                        let reason = error.to_string();
                        seat.session().close(shared.clock.now(), CloseCode::Stalled, &reason);
                        return Some((CloseCode::Stalled, reason));
                    }
                }
            }
            ServerTransmit::Datagram(bytes) => connection.send_datagram(bytes),
            ServerTransmit::Frame { number, bytes, priority } => {
                match connection.send_stream(number, bytes, priority) {
                    Ok(()) | Err(SendStreamError::Closed) => {}
                    // The session's window is smaller than the transport's bounds; a frame that is refused all the same
                    // is late soon and is reset then.
                    Err(error) => tracing::debug!(session = seat.id, frame = number, "{error}"),
                }
            }
            ServerTransmit::ResetFrame { number } => {
                connection.reset_stream(number);
            }
            ServerTransmit::Close { code, reason } => return Some((code, reason)),
        }
    }
}

/// When a session must end because the server does.
pub(crate) fn end(seat: &Seat, now: ServerTime) {
    seat.session().close(now, CloseCode::ShuttingDown, "the server shuts down");
    seat.wake.notify_one();
}
