//! Whatever a NRRD header says, loading ends with a volume within the memory allowed, or with an error.
//!
//! An input is a file without its first line, and after the separator the file of voxels `a.raw` beside it.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| holocast_fuzz::load_header("NRRD0004\n", data));
