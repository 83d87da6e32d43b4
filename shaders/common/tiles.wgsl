// Tiles: 8 by 8 neighbouring rays, or fewer where they stand far apart, and what their pass over the cells found. The rays
// of a tile go nearly the same way, so that one look at the cells serves all of them.

// Rays along each side of a tile.
fn tile_side() -> u32 {
    return 1u << frame.tile_power;
}

// The depth of the volume, cut into so many chunks; a bit of a tile's mask says whether its rays may see something there.
const CHUNKS: u32 = 128u;
// Workgroups come in rows of so many: a device takes no more than 65 535.
const GROUPS_A_ROW: u32 = 32768u;

// Workgroups, of 64 rays each, for so many tiles with 2 to the power rays along each side.
fn groups_for(tiles: u32, power: u32) -> u32 {
    return ((tiles << (2u * power)) + 63u) >> 6u;
}

// The ray of an invocation, where a workgroup casts the next 64 of all listed tiles: where it is in its tile, and which of
// the listed ones that is. The rays of a tile are taken in z-order, so that the 8 or 32 that run in step are neighbours.
struct ListedRay {
    inside: vec2<u32>,
    tile: u32,
}

fn listed_ray(group: vec3<u32>, index: u32, power: u32) -> ListedRay {
    let ray = (group.y * GROUPS_A_ROW + group.x) * 64u + index;
    let i = ray & ((1u << (2u * power)) - 1u);
    let x = (i & 1u) | ((i >> 1u) & 2u) | ((i >> 2u) & 4u);
    let y = ((i >> 1u) & 1u) | ((i >> 2u) & 2u) | ((i >> 3u) & 4u);
    return ListedRay(vec2<u32>(x, y), ray >> (2u * power));
}

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
