//! Whatever DICOM files lie in a folder, loading ends with a volume within the memory allowed, or with an error, and says
//! nothing of the patient.
//!
//! An input is one file, and after each separator another of the same folder.
#![no_main]

use libfuzzer_sys::fuzz_target;

const NAMES: [&str; 8] = ["a.dcm", "b.dcm", "c.dcm", "d.dcm", "e.dcm", "f.dcm", "g.dcm", "h.dcm"];

fuzz_target!(|data: &[u8]| {
    let named: Vec<_> = NAMES.into_iter().zip(holocast_fuzz::files(data)).collect();
    holocast_fuzz::load(named[0].0, named[0].1, &named[1..]);
});
