//! The seeds of the fuzz target are what they seem to be: a fuzzer that begins with refused files finds little.

use colour_io::{labels, transfer};

#[test]
fn the_seeds_of_the_fuzz_target_are_read() {
    // They are split as in `fuzz/src/lib.rs`.
    const SEPARATOR: &str = "\n--beside--\n";
    let corpus = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/colours_load");
    let (mut functions, mut tables) = (0, 0);
    for entry in std::fs::read_dir(corpus).unwrap() {
        let path = entry.unwrap().path();
        // What a fuzzer finds is named by its hash and need not be a file of colours.
        if path.file_name().unwrap().len() == 40 {
            continue;
        }
        let seed = std::fs::read_to_string(&path).unwrap();
        let (text, name) =
            seed.split_once(SEPARATOR).map_or((&*seed, None), |(text, name)| (text, Some(name)));
        match (transfer("seed", text, name), labels("seed", text)) {
            (Ok(_), Err(_)) => functions += 1,
            (Err(_), Ok(_)) => tables += 1,
            (function, table) => panic!("{}: {function:?}, {table:?}", path.display()),
        }
    }
    assert_eq!((functions, tables), (5, 5));
}
