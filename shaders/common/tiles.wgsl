// Tiles: 8 by 8 neighbouring rays, and what their pass over the cells found. The rays of a tile go nearly the same way,
// so that one look at the cells serves all of them.

const TILE: u32 = 8u;
// The depth of the volume, cut into so many chunks; a bit of a tile's mask says whether its rays may see something there.
const CHUNKS: u32 = 128u;
// A workgroup casts a tile, in rows of so many: a device takes no more than 65 535.
const TILES_A_ROW: u32 = 32768u;

fn tile_number(tile: vec2<u32>, eye: u32) -> u32 {
    return (eye << 30u) | (tile.y << 15u) | tile.x;
}

fn tile_eye(number: u32) -> u32 {
    return number >> 30u;
}

fn tile_of(number: u32) -> vec2<u32> {
    return vec2<u32>(number & 0x7fffu, (number >> 15u) & 0x7fffu);
}

// Depth of a chunk.
fn chunk_depth(e: Eye) -> f32 {
    return max((e.far - e.near) / f32(CHUNKS), 1.0e-30);
}

// Bits of a word from a place on; the place may be before or behind the word.
fn bits_from(place: vec4<i32>) -> vec4<u32> {
    let shifted = vec4<u32>(0xffffffffu) << vec4<u32>(clamp(place, vec4<i32>(0), vec4<i32>(31)));
    return select(shifted, vec4<u32>(0u), place >= vec4<i32>(32));
}

const WORD_BEGINS: vec4<i32> = vec4<i32>(0, 32, 64, 96);

fn lowest_bit(words: vec4<u32>) -> u32 {
    let at = vec4<u32>(WORD_BEGINS) + countTrailingZeros(words);
    let found = select(vec4<u32>(CHUNKS), at, words != vec4<u32>(0u));
    return min(min(found.x, found.y), min(found.z, found.w));
}

// The first run of set bits at or behind a chunk: its first chunk, and one past its last; both CHUNKS if there is none.
fn run_from(mask: vec4<u32>, chunk: u32) -> vec2<u32> {
    let first = lowest_bit(mask & bits_from(vec4<i32>(i32(chunk)) - WORD_BEGINS));
    let end = lowest_bit(~mask & bits_from(vec4<i32>(i32(first)) - WORD_BEGINS));
    return vec2<u32>(first, end);
}
