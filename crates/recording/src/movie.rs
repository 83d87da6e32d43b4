//! The index of an MP4 file (ISO/IEC 14496-12): what its samples are, where they lie and how long each is shown.

use codec::ParameterSets;
use mp4_atom::{
    Avc1, Avcc, Co64, Codec, Colr, Dinf, Dref, DrefEntry, FourCC, Ftyp, Hdlr, Mdhd, Mdia, Minf, Moov, Mvhd,
    Stbl, Stsc, StscEntry, Stsd, Stss, Stsz, StszSamples, Stts, SttsEntry, Tkhd, Trak, Url, Visual, Vmhd,
};

/// Ticks a second: the usual clock of video, a whole number of ticks for 24, 25, 30, 50, 60, 72 and 90 Hz.
pub(crate) const TICKS_PER_SECOND: u32 = 90_000;

/// A run of samples that lie one after the other in the file and are coded with the same parameter sets.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Chunk {
    /// First byte in the file.
    pub(crate) offset: u64,
    /// Number of samples.
    pub(crate) samples: u32,
    /// Which description they have, from 0.
    pub(crate) description: u32,
}

/// All samples of a file. An access unit is a sample here.
#[derive(Debug, Default)]
pub(crate) struct SampleTable {
    pub(crate) descriptions: Vec<Avc1>,
    pub(crate) chunks: Vec<Chunk>,
    pub(crate) sizes: Vec<u32>,
    /// Ticks from one sample to the next: one less than there are samples.
    pub(crate) gaps: Vec<u32>,
    /// Numbers of the key frames, from 1.
    pub(crate) key_frames: Vec<u32>,
}

impl SampleTable {
    /// How long the last picture is shown: as long as the one before it.
    pub(crate) fn last_duration(&self) -> u32 {
        self.gaps.last().copied().unwrap_or(TICKS_PER_SECOND / 60)
    }

    /// Ticks that all pictures are shown.
    pub(crate) fn duration(&self) -> u64 {
        self.gaps.iter().map(|&gap| u64::from(gap)).sum::<u64>() + u64::from(self.last_duration())
    }
}

/// The beginning of the file.
pub(crate) fn file_type() -> Ftyp {
    Ftyp {
        major_brand: FourCC::new(b"isom"),
        minor_version: 512,
        compatible_brands: [b"isom", b"iso2", b"avc1", b"mp41"].map(FourCC::new).to_vec(),
    }
}

/// How samples with these parameter sets are to be decoded.
pub(crate) fn description(sets: &ParameterSets<'_>) -> Result<Avc1, mp4_atom::Error> {
    Ok(Avc1 {
        visual: Visual {
            data_reference_index: 1,
            // The decoder's limit on sizes is far below.
            width: sets.sps.width_px as u16,
            height: sets.sps.height_px as u16,
            compressor: "holocast".into(),
            ..Visual::default()
        },
        avcc: Avcc::new(sets.sps_bytes, sets.pps_bytes)?,
        colr: sets.sps.colour.map(|colour| Colr::Nclx {
            colour_primaries: colour.primaries.into(),
            transfer_characteristics: colour.transfer.into(),
            matrix_coefficients: colour.matrix.into(),
            full_range_flag: colour.full_range,
        }),
        ..Avc1::default()
    })
}

/// The index. The table holds at least one sample.
pub(crate) fn index(table: SampleTable) -> Moov {
    let duration = table.duration();
    // A stream may change its size: the largest picture sets the window.
    let sides = |side: fn(&Avc1) -> u16| table.descriptions.iter().map(side).max().unwrap_or(0);
    let (width, height) = (sides(|avc1| avc1.visual.width), sides(|avc1| avc1.visual.height));
    Moov {
        mvhd: Mvhd {
            timescale: TICKS_PER_SECOND,
            duration,
            rate: 1.into(),
            volume: 1.into(),
            next_track_id: 2,
            ..Mvhd::default()
        },
        trak: vec![Trak {
            tkhd: Tkhd {
                track_id: 1,
                duration,
                enabled: true,
                in_movie: true,
                width: width.into(),
                height: height.into(),
                ..Tkhd::default()
            },
            mdia: Mdia {
                mdhd: Mdhd {
                    timescale: TICKS_PER_SECOND,
                    duration,
                    language: "und".into(),
                    ..Mdhd::default()
                },
                hdlr: Hdlr { handler: FourCC::new(b"vide"), name: "video".into() },
                minf: Minf {
                    vmhd: Some(Vmhd::default()),
                    dinf: Dinf { dref: Dref { entries: vec![DrefEntry::Url(Url::default())] } },
                    stbl: sample_boxes(table),
                    ..Minf::default()
                },
            },
            ..Trak::default()
        }],
        ..Moov::default()
    }
}

fn sample_boxes(table: SampleTable) -> Stbl {
    let durations = table.gaps.iter().copied().chain([table.last_duration()]);
    let mut times: Vec<SttsEntry> = Vec::new();
    for sample_delta in durations {
        match times.last_mut() {
            Some(last) if last.sample_delta == sample_delta => last.sample_count += 1,
            _ => times.push(SttsEntry { sample_count: 1, sample_delta }),
        }
    }
    let chunks = table.chunks.iter().zip(1..).map(|(chunk, first_chunk)| StscEntry {
        first_chunk,
        samples_per_chunk: chunk.samples,
        sample_description_index: chunk.description + 1,
    });
    Stbl {
        stts: Stts { entries: times },
        stss: Some(Stss { entries: table.key_frames }),
        stsc: Stsc { entries: chunks.collect() },
        stsz: Stsz { samples: StszSamples::Different { sizes: table.sizes } },
        co64: Some(Co64 { entries: table.chunks.iter().map(|chunk| chunk.offset).collect() }),
        stsd: Stsd { codecs: table.descriptions.into_iter().map(Codec::from).collect() },
        ..Stbl::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_durations_are_written_once_and_the_last_is_as_long_as_the_one_before() {
        let table = SampleTable { gaps: vec![1500, 1500, 3000], ..SampleTable::default() };
        assert_eq!(table.duration(), 9000);
        let entry = |sample_count, sample_delta| SttsEntry { sample_count, sample_delta };
        assert_eq!(sample_boxes(table).stts.entries, [entry(2, 1500), entry(2, 3000)]);
    }

    #[test]
    fn a_single_picture_is_shown_for_a_sixtieth_of_a_second() {
        assert_eq!(SampleTable::default().duration(), 1500);
    }
}
