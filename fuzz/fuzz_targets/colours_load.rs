//! Whatever a file of colours says, it gives a transfer function or a table of labels that a scene takes, or an error; and
//! nothing of it steers a terminal.
//!
//! An input is a file, and after the separator the name of the entry that is asked for.
#![no_main]

use colour_io::{labels, transfer};
use libfuzzer_sys::fuzz_target;
use scene::Window;

/// Windows over which a colour map is stretched: the last is the widest that a scene takes.
const WINDOWS: [Window; 3] = [
    Window { low: -160.0, high: 240.0 },
    Window { low: 0.0, high: 1.0e-12 },
    Window { low: -1.0e12, high: 1.0e12 },
];

fuzz_target!(|data: &[u8]| {
    let files = holocast_fuzz::files(data);
    let text = String::from_utf8_lossy(files[0]);
    let name = files.get(1).map(|name| String::from_utf8_lossy(name));
    match transfer("a", &text, name.as_deref()) {
        Ok(imported) => {
            let words = imported.notes.iter().chain(&imported.name);
            assert!(words.into_iter().all(|words| !words.contains(char::is_control)));
            for function in WINDOWS.iter().filter_map(|window| imported.over(*window).ok()) {
                assert!(function.points().iter().all(|point| {
                    let mut numbers = point.color.into_iter().chain([point.opacity_per_mm]);
                    point.value.is_finite() && numbers.all(|n| (0.0..=1.0).contains(&n))
                }));
            }
        }
        Err(error) => assert!(error.to_string().len() < 20_000),
    }
    match labels("a", &text) {
        Ok(table) => {
            assert!(!table.is_empty());
            for label in table.labels() {
                let mut numbers = label.color.into_iter().flatten().chain(label.opacity);
                assert!(numbers.all(|n| (0.0..=1.0).contains(&n)) && !label.name.contains(char::is_control));
            }
        }
        Err(error) => assert!(!error.to_string().contains(char::is_control)),
    }
});
