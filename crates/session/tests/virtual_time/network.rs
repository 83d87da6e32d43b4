//! What QUIC makes of a lossy link: datagrams that may vanish, and streams that come whole or are reset.
//!
//! Streams are cut into packets, the highest priority first, within a window of bytes on their way. A packet that is
//! lost is sent again after a while. This is no QUIC, but it has what matters above it: streams arrive late rather than
//! never, a full path delays them, and priorities and resets decide what goes first.

use netsim::{Fate, Link, LinkSettings};
use std::collections::{BTreeMap, BinaryHeap, VecDeque};

/// Payload of a packet in bytes.
const PACKET_BYTES: usize = 1200;
/// The control stream goes before all frames.
const CONTROL: Key = Key::Control;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Key {
    Frame(u64),
    Control,
}

#[derive(Clone, Debug)]
enum Packet {
    Datagram(Vec<u8>),
    Chunk { key: Key, offset: usize, bytes: Vec<u8>, total: Option<usize> },
    Reset { frame: u64 },
}

/// What comes out at the far end.
#[derive(Debug, PartialEq)]
pub(crate) enum Arrival {
    Datagram(Vec<u8>),
    Control(Vec<u8>),
    Frame(Vec<u8>),
    FrameReset { part: Vec<u8> },
}

#[derive(Debug)]
struct Outgoing {
    key: Key,
    priority: i32,
    offset: usize,
    bytes: Vec<u8>,
    total: Option<usize>,
}

#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Word {
    Acknowledged { bytes: u64 },
    Lost { bytes: u64, key: Key, priority: i32, offset: usize, chunk: Vec<u8>, total: Option<usize> },
}

/// One direction of a connection.
#[derive(Debug)]
pub(crate) struct Path {
    link: Link<Packet>,
    /// Bytes that may be on their way.
    window_bytes: u64,
    /// Chunks that wait to be sent.
    waiting: Vec<Outgoing>,
    on_the_way_bytes: u64,
    words: BinaryHeap<std::cmp::Reverse<(u64, u64, Word)>>,
    next_word: u64,
    control_sent: usize,
    control_received: usize,
    control_ahead: BTreeMap<usize, Vec<u8>>,
    frames: BTreeMap<u64, Vec<Option<u8>>>,
    finished: Vec<u64>,
    reset: Vec<u64>,
}

impl Path {
    pub(crate) fn new(settings: LinkSettings, window_bytes: u64, seed: u64) -> Self {
        Self {
            link: Link::new(settings, seed),
            window_bytes,
            waiting: Vec::new(),
            on_the_way_bytes: 0,
            words: BinaryHeap::new(),
            next_word: 0,
            control_sent: 0,
            control_received: 0,
            control_ahead: BTreeMap::new(),
            frames: BTreeMap::new(),
            finished: Vec::new(),
            reset: Vec::new(),
        }
    }

    pub(crate) fn set_link(&mut self, settings: LinkSettings) {
        self.link.set(settings);
    }

    pub(crate) fn send_datagram(&mut self, now: u64, bytes: Vec<u8>) {
        let size = bytes.len() as u64 + 40;
        self.link.send(now, Packet::Datagram(bytes), size);
    }

    pub(crate) fn send_control(&mut self, now: u64, bytes: &[u8]) {
        for chunk in bytes.chunks(PACKET_BYTES) {
            let offset = self.control_sent;
            self.control_sent += chunk.len();
            let (bytes, priority) = (chunk.to_vec(), i32::MAX);
            self.waiting.push(Outgoing { key: CONTROL, priority, offset, bytes, total: None });
        }
        self.pump(now);
    }

    pub(crate) fn send_frame(&mut self, now: u64, frame: u64, bytes: &[u8], priority: i32) {
        for (i, chunk) in bytes.chunks(PACKET_BYTES).enumerate() {
            self.waiting.push(Outgoing {
                key: Key::Frame(frame),
                priority,
                offset: i * PACKET_BYTES,
                bytes: chunk.to_vec(),
                total: Some(bytes.len()),
            });
        }
        self.pump(now);
    }

    pub(crate) fn reset_frame(&mut self, now: u64, frame: u64) {
        self.waiting.retain(|chunk| chunk.key != Key::Frame(frame));
        self.reset.push(frame);
        // A reset is sent again like anything else; here it is so until it gets through.
        self.say(now, lost_reset(frame));
        self.advance(now);
    }

    /// When something happens here next.
    pub(crate) fn next_event(&self) -> Option<u64> {
        let word = self.words.peek().map(|word| word.0.0);
        [word, self.link.next_arrival()].into_iter().flatten().min()
    }

    /// Lets time pass at the sending end.
    pub(crate) fn advance(&mut self, now: u64) {
        while self.words.peek().is_some_and(|word| word.0.0 <= now) {
            let Some(std::cmp::Reverse((_, _, word))) = self.words.pop() else { break };
            match word {
                Word::Acknowledged { bytes } => self.on_the_way_bytes -= bytes,
                Word::Lost { offset: usize::MAX, key: Key::Frame(frame), .. } => {
                    if !matches!(self.link.send(now, Packet::Reset { frame }, 40), Fate::Arrives { .. }) {
                        self.say(now + self.patience(), lost_reset(frame));
                    }
                }
                Word::Lost { bytes, key, priority, offset, chunk, total } => {
                    self.on_the_way_bytes -= bytes;
                    let is_reset = matches!(key, Key::Frame(frame) if self.reset.contains(&frame));
                    if !is_reset {
                        self.waiting.push(Outgoing { key, priority, offset, bytes: chunk, total });
                    }
                }
            }
        }
        self.pump(now);
    }

    fn pump(&mut self, now: u64) {
        while self.on_the_way_bytes < self.window_bytes {
            // The highest priority, of that the earliest stream, of that the first chunk.
            let Some(next) = (0..self.waiting.len())
                .max_by_key(|&i| (self.waiting[i].priority, std::cmp::Reverse(self.waiting[i].offset)))
            else {
                return;
            };
            let Outgoing { key, priority, offset, bytes: chunk, total } = self.waiting.swap_remove(next);
            let bytes = chunk.len() as u64 + 40;
            self.on_the_way_bytes += bytes;
            let packet = Packet::Chunk { key, offset, bytes: chunk.clone(), total };
            match self.link.send(now, packet, bytes) {
                Fate::Arrives { at_us } => {
                    let heard_at = at_us + self.link.settings().delay_us;
                    self.say(heard_at, Word::Acknowledged { bytes });
                }
                _ => {
                    self.say(
                        now + self.patience(),
                        Word::Lost { bytes, key, priority, offset, chunk, total },
                    );
                }
            }
        }
    }

    /// Time after which a lost packet is sent again.
    fn patience(&self) -> u64 {
        2 * self.link.settings().delay_us + self.link.settings().jitter_us + 10_000
    }

    fn say(&mut self, at: u64, word: Word) {
        let order = self.next_word;
        self.next_word += 1;
        self.words.push(std::cmp::Reverse((at, order, word)));
    }

    /// What has arrived at the far end by `now`, in order.
    pub(crate) fn receive(&mut self, now: u64) -> VecDeque<Arrival> {
        let mut arrivals = VecDeque::new();
        while let Some(packet) = self.link.receive(now) {
            match packet {
                Packet::Datagram(bytes) => arrivals.push_back(Arrival::Datagram(bytes)),
                Packet::Chunk { key: Key::Control, offset, bytes, .. } => {
                    self.control_ahead.insert(offset, bytes);
                    while let Some(bytes) = self.control_ahead.remove(&self.control_received) {
                        self.control_received += bytes.len();
                        arrivals.push_back(Arrival::Control(bytes));
                    }
                }
                Packet::Chunk { key: Key::Frame(frame), offset, bytes, total } => {
                    if self.finished.contains(&frame) {
                        continue;
                    }
                    let stream = self.frames.entry(frame).or_insert_with(|| vec![None; total.unwrap_or(0)]);
                    for (i, byte) in bytes.into_iter().enumerate() {
                        stream[offset + i] = Some(byte);
                    }
                    if stream.iter().all(Option::is_some) {
                        self.finished.push(frame);
                        let stream = self.frames.remove(&frame).unwrap_or_default();
                        arrivals.push_back(Arrival::Frame(stream.into_iter().flatten().collect()));
                    }
                }
                Packet::Reset { frame } => {
                    if !self.finished.contains(&frame) {
                        self.finished.push(frame);
                        let stream = self.frames.remove(&frame).unwrap_or_default();
                        let part = stream.into_iter().map_while(|byte| byte).collect();
                        arrivals.push_back(Arrival::FrameReset { part });
                    }
                }
            }
        }
        arrivals
    }
}

fn lost_reset(frame: u64) -> Word {
    Word::Lost {
        bytes: 0,
        key: Key::Frame(frame),
        priority: i32::MAX,
        offset: usize::MAX,
        chunk: Vec::new(),
        total: None,
    }
}
