//! Colours that people with any colour vision tell apart.

/// A colour with opacity: red, green, blue, alpha, not premultiplied, sRGB.
pub(super) type Colour = [u8; 4];

pub(super) const INK: Colour = [0x22, 0x22, 0x22, 255];
pub(super) const FAINT_INK: Colour = [0x66, 0x66, 0x66, 255];
pub(super) const GRID: Colour = [0, 0, 0, 60];
pub(super) const STRIP: Colour = [0xf4, 0xf4, 0xf4, 255];
/// What is wrong with a frame.
pub(super) const ALARM: Colour = [0xb0, 0x00, 0x20, 255];

/// The palette of Okabe and Ito (*Color Universal Design*, 2008) but for black, in an order in which neighbours differ
/// in lightness too.
const OKABE_ITO: [Colour; 7] = [
    [0x56, 0xb4, 0xe9, 255],
    [0xe6, 0x9f, 0x00, 255],
    [0xf0, 0xe4, 0x42, 255],
    [0x00, 0x9e, 0x73, 255],
    [0xd5, 0x5e, 0x00, 255],
    [0x00, 0x72, 0xb2, 255],
    [0xcc, 0x79, 0xa7, 255],
];

/// Waiting is grey, so that work stands out.
const WAITS: [Colour; 3] = [[0xd2, 0xd2, 0xd2, 255], [0xa6, 0xa6, 0xa6, 255], [0x80, 0x80, 0x80, 255]];

/// A colour for the series at `index`; the seventh is black.
pub(super) fn series(index: usize) -> Colour {
    // Yellow is for areas: a line of it is lost on white.
    const LINES: [usize; 6] = [5, 1, 3, 4, 0, 6];
    LINES.get(index % (LINES.len() + 1)).map_or(INK, |line| OKABE_ITO[*line])
}

/// A colour for each stage: those that wait are grey.
pub(super) fn stages<'name>(names: impl Iterator<Item = &'name str>) -> Vec<Colour> {
    let (mut works, mut waits) = (OKABE_ITO.iter().cycle(), WAITS.iter().cycle());
    names
        .filter_map(|name| if name.contains("wait") { waits.next() } else { works.next() })
        .copied()
        .collect()
}
