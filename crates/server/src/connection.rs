//! A connection's task: drives one session.

use crate::seat::Seat;
use crate::server::Shared;
use session::{ServerEvent, ServerTime, ServerTransmit};
use std::sync::Arc;
use std::time::Duration;
use transport::{Connection, Event, SendStreamError};
use wire::CloseCode;

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
        if let Some((code, reason)) = send_all(&connection, &seat) {
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
        Event::Control(bytes) => session.handle_control(now, &bytes),
        Event::Datagram(bytes) => session.handle_datagram(now, &bytes),
        Event::Closed { code, reason, .. } => {
            session.handle_disconnect(now, code.and_then(CloseCode::from_value), &reason);
        }
        // A headset opens no streams but the control stream; the transport's limits refuse them.
        Event::Stream { .. } | Event::StreamReset { .. } | Event::StreamTooLarge { .. } => {
            session.close(now, CloseCode::BadMessage, "a stream beside the control stream, expected none");
        }
    }
}

fn handle_events(shared: &Arc<Shared>, seat: &Arc<Seat>, session: &mut session::ServerSession) {
    while let Some(event) = session.poll_event() {
        let now = shared.clock.now();
        match event {
            ServerEvent::Connected { device } => {
                match seat.open_stream(&device, shared.settings.bits_per_pixel) {
                    Ok(terms) => {
                        tracing::info!(
                            session = seat.id, peer = %seat.peer, device = %device.name,
                            "headset connected: {}x{} at {} Hz, {:.1} Mbit/s",
                            terms.width_px, terms.height_px, terms.refresh_hz,
                            f64::from(terms.bitrate_bps) / 1e6
                        );
                        session.welcome(now, &terms);
                    }
                    Err(error) => session.close(now, CloseCode::BadDevice, &error.to_string()),
                }
            }
            ServerEvent::SceneRequested { request_id, scene_json } => {
                change_scene(shared.clone(), seat.clone(), request_id, scene_json);
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

/// Makes the scene beside everything else, then tells all headsets.
fn change_scene(shared: Arc<Shared>, seat: Arc<Seat>, request_id: u32, scene_json: String) {
    tokio::task::spawn_blocking(move || match shared.room.change(&scene_json) {
        Ok(revision) => {
            tracing::info!(session = seat.id, revision, "scene changed");
            for other in shared.seats().iter() {
                let request = (other.id == seat.id).then_some(request_id);
                other.session().scene_changed(request, revision, Some(&scene_json));
                other.wake.notify_one();
            }
        }
        Err(error) => {
            tracing::info!(session = seat.id, "scene refused: {error}");
            seat.session().scene_refused(request_id, &error.to_string());
            seat.wake.notify_one();
        }
    });
}

/// Sends what the session wants sent; returns code and reason if the connection is to be closed.
fn send_all(connection: &Connection, seat: &Seat) -> Option<(CloseCode, String)> {
    loop {
        let transmit = seat.session().poll_transmit()?;
        match transmit {
            ServerTransmit::Control(bytes) => {
                if let Err(error) = connection.send_control(bytes) {
                    return Some((CloseCode::Stalled, error.to_string()));
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
