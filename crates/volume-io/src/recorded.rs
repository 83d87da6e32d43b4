//! What NIfTI, NRRD and MetaImage have in common once their header is read: one channel of samples, to be read from a
//! stream.

use crate::load::{Sequence, finish};
use crate::pieces::{Pieces, Skipped};
use crate::samples::{self, ByteOrder, Run, StoredType};
use crate::source::Source;
use crate::stream::{self, Encoding, Stream};
use crate::{Format, LoadError, LoadOptions, Loaded};
use std::io::Read;
use volume::{Channel, ChannelKind, Grid};

/// What a header says about the samples of its file.
pub(crate) struct Recorded {
    pub(crate) format: Format,
    pub(crate) grid: Grid,
    pub(crate) encoding: Encoding,
    pub(crate) stored: StoredType,
    pub(crate) order: ByteOrder,
    /// Volumes that follow each other.
    pub(crate) steps: u64,
    /// Which of them is wanted, counted from 0.
    pub(crate) step: u64,
    /// Seconds from one to the next, if the file says so.
    pub(crate) step_secs: Option<f64>,
    /// Value of a stored unit, and of a stored 0.
    pub(crate) scaling: (f64, f64),
    /// Whether the file says that its samples name structures.
    pub(crate) labels: bool,
}

impl Recorded {
    /// Refuses a volume larger than the caller allows, a series whose bytes cannot be counted, and a step that it does
    /// not have; `field` is what says how long its axes are.
    pub(crate) fn check(&self, file: &str, field: &str, options: &LoadOptions) -> Result<(), LoadError> {
        options.check_size(file, self.grid.voxel_count() as u128 * self.stored.held_bytes() as u128)?;
        if self.bytes().checked_mul(self.steps).is_none() {
            let found = format!("{} volumes", self.steps);
            return Err(LoadError::field(file, field, "a file of less than 2^64 bytes", &found));
        }
        Sequence::check(file, self.steps, options)
    }

    /// Bytes of a volume, as raw samples.
    pub(crate) fn bytes(&self) -> u64 {
        // Three axes of 15 bits and samples of at most 8 bytes: no product overflows 64 bits.
        self.grid.voxel_count() as u64 * self.stored.bytes() as u64
    }

    /// Bytes of the volumes before the one that is wanted.
    pub(crate) fn before(&self) -> u64 {
        self.bytes().saturating_mul(self.step)
    }

    /// Bytes of all volumes of the series.
    pub(crate) fn whole(&self) -> u64 {
        // The product was checked.
        self.bytes().saturating_mul(self.steps)
    }

    /// The wanted volume where the series lies in several files of raw voxels, which the header's `field` names. As many
    /// bytes are in each.
    pub(crate) fn in_files<'s, 'a>(
        &self,
        source: &'s Source<'a>,
        field: &'static str,
        names: Vec<String>,
        skipped: Skipped,
    ) -> Result<Stream<Box<dyn Read + 's>>, LoadError> {
        let bytes = self.whole() / names.len() as u64;
        let (first, end) = (self.before() / bytes, (self.before() + self.bytes()).div_ceil(bytes));
        let names = names.into_iter().skip(first as usize).take((end - first) as usize).collect();
        let chain = Pieces { source, field, names, skipped, bytes }.open()?;
        let within = self.before() % bytes;
        let holds_at_most = within + self.bytes();
        let mut stream = Stream { input: Box::new(chain) as Box<dyn Read + 's>, holds_at_most, packed: None };
        stream::pass_over(&source.name(), &mut stream, within, "the volumes before")?;
        Ok(stream)
    }

    /// Reads the samples and makes them the volume's only channel. What follows the last volume is looked at if
    /// `has_tail`.
    pub(crate) fn load(
        self,
        file: &str,
        mut stream: Stream<impl Read>,
        has_tail: bool,
        options: &LoadOptions,
        mut notes: Vec<String>,
    ) -> Result<Loaded, LoadError> {
        let Self { grid, stored, order, .. } = self;
        let Stream { holds_at_most, packed, .. } = stream;
        let run = Run { file, stored, order, count: grid.voxel_count(), holds_at_most, packed };
        let held = samples::read(&mut stream.input, &run, options)?;
        if self.steps == 1 && has_tail {
            stream::check_tail(file, &mut stream, &mut notes)?;
        }
        let (slope, intercept) = self.scaling;
        held.note(stored, slope, &mut notes);
        let kind = if self.labels { ChannelKind::Label } else { ChannelKind::Intensity };
        let kind = options.kind.unwrap_or(kind);
        let name = if kind == ChannelKind::Label { "labels" } else { "image" }.to_owned();
        let channel = Channel { name, kind, voxels: held.voxels, slope, intercept };
        let sequence = (self.steps > 1).then_some(Sequence {
            steps: self.steps,
            loaded: self.step,
            step_secs: self.step_secs,
        });
        notes.extend(sequence.iter().map(Sequence::note));
        let mut loaded = finish(file, self.format, grid, vec![channel], notes)?;
        loaded.report.sequence = sequence;
        Ok(loaded)
    }
}
