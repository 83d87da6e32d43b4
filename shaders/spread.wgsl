// Between rays: of every other pixel of every other row the ray was cast. Where four of them see nearly the same, the three
// pixels between are interpolated; where they do not, the pixels are listed, and their rays are cast.

// Count rays: pixels that have none stay empty.
override COUNT: bool = false;

// How steep a surface may be for depths between rays to be interpolated: millimetres of depth over millimetres across. Two
// rays stand two pixels apart, so that a depth between them is off by at most four pixels' width, and an eye that moves
// aside by an eighth of the distance sees it at most half a pixel off.
const STEEPEST: f32 = 4.0;

struct Work {
    groups: vec3<u32>,
    tile_count: u32,
    first_groups: vec3<u32>,
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

// An invocation looks at a ray, the one right of it, the one below, and the one right of that; a workgroup at 64 of those of
// listed tiles.
@compute @workgroup_size(64)
fn spread(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let ray = listed_ray(group, index, frame.tile_power - 1u);
    let number = work.tiles[min(ray.tile, work.tile_count - 1u)];
    let eye = tile_eye(number);
    let place = (tile_of(number) << vec2<u32>(frame.tile_power - 1u)) + ray.inside;
    let pixel = 2u * place;
    if (ray.tile >= work.tile_count || any(pixel >= frame.render_size)) {
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
    let mm = vec4<f32>(textureLoad(first_depth_mm, place, eye, 0).r, textureLoad(first_depth_mm, right, eye, 0).r,
        textureLoad(first_depth_mm, below, eye, 0).r, textureLoad(first_depth_mm, across, eye, 0).r);
    put(pixel, eye, a, mm.x);
    let lowest = min(min(a, b), min(c, d));
    let highest = max(max(a, b), max(c, d));
    // A tile that sees nothing is not listed: what lies between something and nothing is never interpolated, so that a
    // picture is the same whether such tiles are left out or not.
    let alike = (lowest.a > 0.0 || highest.a <= 0.0) && all(highest - lowest <= vec4<f32>(frame.interpolated_below));
    // Nor between a depth and none: a mean of opacities would say one thing and its depth another.
    let has_depth = mm > vec4<f32>(0.0);
    if (!alike || any(has_depth) != all(has_depth) || any(place == last)) {
        let at = atomicAdd(&rest.pixel_count, 3u);
        rest.pixels[at] = tile_number(pixel + vec2<u32>(1u, 0u), eye);
        rest.pixels[at + 1u] = tile_number(pixel + vec2<u32>(0u, 1u), eye);
        rest.pixels[at + 2u] = tile_number(pixel + vec2<u32>(1u, 1u), eye);
        let groups = (at + 2u) / 64u + 1u;
        atomicMax(&rest.groups_x, min(groups, GROUPS_A_ROW));
        atomicMax(&rest.groups_y, (groups - 1u) / GROUPS_A_ROW + 1u);
        atomicMax(&rest.groups_z, 1u);
        return;
    }
    // As far apart as two rays are at the nearest of the depths, along each direction. Depths are along the rays, so that they
    // are taken as parts of the direction of the pixel in the middle of the four.
    let e = frame.eyes[eye];
    let xy = (vec2<f32>(pixel) + 1.5) / vec2<f32>(frame.render_size) - 0.5;
    let away = min(min(mm.x, mm.y), min(mm.z, mm.w)) / length(e.ray_mm + xy.x * e.ray_dx_mm + xy.y * e.ray_dy_mm);
    let apart = 2.0 * away * vec2<f32>(length(e.ray_dx_mm), length(e.ray_dy_mm)) / vec2<f32>(frame.render_size);
    // Surfaces that part are not bridged: the pixels take a ray's own depth.
    let joined = abs(mm.xzxy - mm.ywzw) <= STEEPEST * apart.xxyy;
    let between = select(mm.xxx, vec3<f32>(0.5 * (mm.x + mm.y), 0.5 * (mm.x + mm.z), 0.25 * ((mm.x + mm.y) + (mm.z + mm.w))),
        vec3<bool>(joined.x, joined.z, all(joined)));
    put(pixel + vec2<u32>(1u, 0u), eye, 0.5 * (a + b), between.x);
    put(pixel + vec2<u32>(0u, 1u), eye, 0.5 * (a + c), between.y);
    put(pixel + vec2<u32>(1u, 1u), eye, 0.25 * ((a + b) + (c + d)), between.z);
}
