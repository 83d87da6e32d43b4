// Between rays: of every other pixel of every other row the ray was cast. Where four of them see nearly the same, the three
// pixels between are interpolated; where they do not, the pixels are listed, and their rays are cast.

// Count rays: pixels that have none stay empty.
override COUNT: bool = false;

// How steep a surface may be for depths between rays to be interpolated: millimetres of depth over millimetres across.
const STEEPEST: f32 = 4.0;

struct Work {
    groups: vec3<u32>,
    tile_count: u32,
    groups_of_four: vec3<u32>,
    tiles: array<u32>,
}

// As the ray-caster takes it: what it calls tiles are pixels.
struct Rest {
    groups_x: atomic<u32>,
    groups_y: atomic<u32>,
    groups_z: atomic<u32>,
    pixel_count: atomic<u32>,
    unused_x: u32,
    unused_y: u32,
    unused_z: u32,
    pixels: array<u32>,
}

// A layer an eye, a pixel for each ray that was cast.
@group(1) @binding(0) var first_picture: texture_2d_array<f32>;
@group(1) @binding(1) var first_depth_mm: texture_2d_array<f32>;
@group(1) @binding(2) var picture: texture_storage_2d_array<rgba32float, write>;
@group(1) @binding(3) var depth_mm: texture_storage_2d_array<r32float, write>;
@group(1) @binding(4) var<storage, read> work: Work;
@group(1) @binding(5) var<storage, read_write> rest: Rest;

fn put(pixel: vec2<u32>, eye: u32, color: vec4<f32>, depth: f32) {
    textureStore(picture, pixel, eye, select(color, vec4<f32>(0.0), COUNT));
    textureStore(depth_mm, pixel, eye, vec4<f32>(depth, 0.0, 0.0, 0.0));
}

// An invocation looks at a ray, the one right of it, the one below, and the one right of that; a workgroup at those of four
// listed tiles.
@compute @workgroup_size(64)
fn spread(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let listed = (group.y * TILES_A_ROW + group.x) * 4u + (index >> 4u);
    let number = work.tiles[min(listed, work.tile_count - 1u)];
    let eye = tile_eye(number);
    let place = (tile_of(number) * TILE) / 2u + vec2<u32>(index & 3u, (index >> 2u) & 3u);
    let pixel = 2u * place;
    if (listed >= work.tile_count || any(pixel >= frame.render_size)) {
        return;
    }
    let last = (frame.render_size - 1u) / 2u;
    let right = vec2<u32>(min(place.x + 1u, last.x), place.y);
    let below = vec2<u32>(place.x, min(place.y + 1u, last.y));
    let across = vec2<u32>(right.x, below.y);
    let a = textureLoad(first_picture, place, eye, 0);
    let b = textureLoad(first_picture, right, eye, 0);
    let c = textureLoad(first_picture, below, eye, 0);
    let d = textureLoad(first_picture, across, eye, 0);
    let a_mm = textureLoad(first_depth_mm, place, eye, 0).r;
    put(pixel, eye, a, a_mm);
    let lowest = min(min(a, b), min(c, d));
    let highest = max(max(a, b), max(c, d));
    // A tile that sees nothing is not listed: what lies between something and nothing is never interpolated, so that a
    // picture is the same whether such tiles are left out or not.
    let alike = (lowest.a > 0.0 || highest.a <= 0.0) && all(highest - lowest <= vec4<f32>(frame.interpolated_below));
    if (!alike || any(place == last)) {
        let at = atomicAdd(&rest.pixel_count, 3u);
        rest.pixels[at] = tile_number(pixel + vec2<u32>(1u, 0u), eye);
        rest.pixels[at + 1u] = tile_number(pixel + vec2<u32>(0u, 1u), eye);
        rest.pixels[at + 2u] = tile_number(pixel + vec2<u32>(1u, 1u), eye);
        let groups = (at + 2u) / 64u + 1u;
        atomicMax(&rest.groups_x, min(groups, TILES_A_ROW));
        atomicMax(&rest.groups_y, (groups - 1u) / TILES_A_ROW + 1u);
        atomicMax(&rest.groups_z, 1u);
        return;
    }
    var mm = vec3<f32>(a_mm);
    let b_mm = textureLoad(first_depth_mm, right, eye, 0).r;
    let c_mm = textureLoad(first_depth_mm, below, eye, 0).r;
    let d_mm = textureLoad(first_depth_mm, across, eye, 0).r;
    let nearest = min(min(a_mm, b_mm), min(c_mm, d_mm));
    let farthest = max(max(a_mm, b_mm), max(c_mm, d_mm));
    let e = frame.eyes[eye];
    let apart = 2.0 * nearest * length(e.ray_dx_mm) / (f32(frame.render_size.x) * length(e.ray_mm));
    // Surfaces that part are not bridged: the pixels take a ray's own depth.
    if (nearest > 0.0 && farthest - nearest <= STEEPEST * apart) {
        mm = vec3<f32>(0.5 * (a_mm + b_mm), 0.5 * (a_mm + c_mm), 0.25 * ((a_mm + b_mm) + (c_mm + d_mm)));
    }
    put(pixel + vec2<u32>(1u, 0u), eye, 0.5 * (a + b), mm.x);
    put(pixel + vec2<u32>(0u, 1u), eye, 0.5 * (a + c), mm.y);
    put(pixel + vec2<u32>(1u, 1u), eye, 0.25 * ((a + b) + (c + d)), mm.z);
}
