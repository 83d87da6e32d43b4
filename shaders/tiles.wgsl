// Finds, for each tile of rays, where along the depth they may see something, and lists the tiles that may see anything.
//
// A tile's rays fill a beam: a box around its middle ray, which grows with depth. A chunk is left out if the beam lies in
// cells that hold nothing to be seen, all the way through the chunk.

// Whether some cells are empty.
override SKIP: bool = true;
// Whether the mode shows all of the way, empty or not.
override ALL_OF_THE_WAY: bool = false;
// Whether rays of every other pixel of every other row are cast before the others.
override SPREAD: bool = false;

@group(2) @binding(0) var distance_to_seen: texture_3d<u32>;

struct Work {
    // Workgroups to cast, as an indirect dispatch takes them.
    groups_x: atomic<u32>,
    groups_y: atomic<u32>,
    groups_z: atomic<u32>,
    tile_count: atomic<u32>,
    // The same where a ray of every other pixel of every other row is cast.
    first_x: atomic<u32>,
    first_y: atomic<u32>,
    first_z: atomic<u32>,
    tiles: array<u32>,
}

// A layer an eye: the mask of chunks.
@group(3) @binding(0) var masks: texture_storage_2d_array<rgba32uint, write>;
@group(3) @binding(1) var<storage, read_write> work: Work;
@group(3) @binding(2) var picture: texture_storage_2d_array<rgba32float, write>;
@group(3) @binding(3) var depth_mm: texture_storage_2d_array<r32float, write>;
@group(3) @binding(4) var first_picture: texture_storage_2d_array<rgba32float, write>;
@group(3) @binding(5) var first_depth_mm: texture_storage_2d_array<r32float, write>;

const FAR_AWAY: f32 = 1.0e30;

// Where a + s * b is above 0: the least s if b is above 0, the greatest if below.
fn root(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    let least = vec3<f32>(1.0e-30);
    return -a / select(b, select(-least, least, b >= vec3<f32>(0.0)), abs(b) < least);
}

@compute @workgroup_size(8, 8)
fn find(@builtin(global_invocation_id) id: vec3<u32>) {
    let tile = id.xy;
    let eye = id.z;
    let side = tile_side();
    let tiles = (frame.render_size + (side - 1u)) / side;
    if (tile.x >= tiles.x || tile.y >= tiles.y) {
        return;
    }
    let e = frame.eyes[eye];
    let pixel = vec2<f32>(1.0) / vec2<f32>(frame.render_size);
    // A tile at the border holds fewer rays.
    let corner = vec2<f32>(tile * side);
    let opposite = min(corner + f32(side), vec2<f32>(frame.render_size));
    let xy = 0.5 * (corner + opposite) * pixel - 0.5;
    // Depth s is counted from the anchor. The middle of the beam is at `anchor + s * direction`, and it reaches
    // `margin + s * spread` to each side.
    let anchor = e.anchor + e.anchor_depth * (xy.x * e.ray_dx + xy.y * e.ray_dy);
    let direction = e.ray + xy.x * e.ray_dx + xy.y * e.ray_dy;
    let half_tile = 0.5 * (opposite - corner) * pixel;
    let spread = half_tile.x * abs(e.ray_dx) + half_tile.y * abs(e.ray_dy);
    // Half a step more: the last sample of a ray lies off the lattice.
    let mm = length(e.ray_mm + xy.x * e.ray_dx_mm + xy.y * e.ray_dy_mm);
    let margin = e.anchor_depth * spread + CELL_MARGIN + (0.5 * frame.step_mm / mm) * abs(direction);
    let upper = direction + spread;
    let lower = direction - spread;

    // Where the beam meets the volume.
    let most = frame.dims - 0.5;
    let enters = root(anchor + margin + 0.5, upper);
    let leaves = root(most - anchor + margin, -lower);
    let near = max(select(vec3<f32>(-FAR_AWAY), enters, upper > vec3<f32>(0.0)),
        select(vec3<f32>(-FAR_AWAY), leaves, lower < vec3<f32>(0.0)));
    let far = min(select(vec3<f32>(FAR_AWAY), enters, upper < vec3<f32>(0.0)),
        select(vec3<f32>(FAR_AWAY), leaves, lower > vec3<f32>(0.0)));
    let first_depth = e.near - e.anchor_depth;
    let depth = chunk_depth(e);
    var s = max(max(near.x, near.y), max(near.z, first_depth));
    let end = min(min(far.x, far.y), min(far.z, e.far - e.anchor_depth));
    let meets = s <= end;

    var mask = vec4<u32>(0u);
    var chunk = u32(clamp((s - first_depth) / depth, 0.0, f32(CHUNKS - 1u)));
    if (!SKIP) {
        let last = u32(clamp((end - first_depth) / depth, 0.0, f32(CHUNKS - 1u)));
        mask = bits_from(vec4<i32>(i32(chunk)) - WORD_BEGINS) & ~bits_from(vec4<i32>(i32(last + 1u)) - WORD_BEGINS);
    }
    loop {
        if (!SKIP || s > end || chunk >= CHUNKS) {
            break;
        }
        let p = anchor + s * direction;
        let reach_out = margin + s * spread;
        let cell = cell_of(p, CELL);
        let reach = i32(textureLoad(distance_to_seen, cell, 0).r * frame.skip_empty);
        // The block of empty cells around this one. Beyond the volume there is nothing.
        let first_cell = cell - (reach - 1);
        let end_cell = cell + reach;
        let low = select(vec3<f32>(first_cell) * CELL, vec3<f32>(-FAR_AWAY), first_cell <= vec3<i32>(0));
        let high = select(vec3<f32>(end_cell) * CELL, vec3<f32>(FAR_AWAY), end_cell >= vec3<i32>(frame.cells));
        let below = p - reach_out - low;
        let above = high - p - reach_out;
        // How far on until the beam leaves the block, if it lies in it.
        let up = select(vec3<f32>(FAR_AWAY), above / upper, upper > vec3<f32>(0.0));
        let down = select(vec3<f32>(FAR_AWAY), below / -lower, lower < vec3<f32>(0.0));
        let on = min(min(min(up.x, up.y), up.z), min(min(down.x, down.y), down.z));
        let inside = reach > 0 && all(below > vec3<f32>(0.0)) && all(above > vec3<f32>(0.0));
        if (inside && on > 0.25 * depth) {
            s += on;
            chunk = max(chunk, u32(clamp((s - first_depth) / depth, 0.0, f32(CHUNKS))));
        } else {
            mask |= bits_from(vec4<i32>(i32(chunk)) - WORD_BEGINS) & ~bits_from(vec4<i32>(i32(chunk + 1u)) - WORD_BEGINS);
            chunk += 1u;
            s = first_depth + f32(chunk) * depth;
        }
    }
    mask = select(vec4<u32>(0u), mask, meets);
    textureStore(masks, tile, eye, mask);
    // Where a mode shows all of the way, a tile is cast if it meets the volume at all.
    if (any(mask != vec4<u32>(0u)) || (ALL_OF_THE_WAY && meets)) {
        let at = atomicAdd(&work.tile_count, 1u);
        work.tiles[at] = tile_number(tile, eye);
        let groups = groups_for(at + 1u, frame.tile_power);
        atomicMax(&work.groups_x, min(groups, GROUPS_A_ROW));
        atomicMax(&work.groups_y, (groups - 1u) / GROUPS_A_ROW + 1u);
        atomicMax(&work.groups_z, 1u);
        if (SPREAD) {
            let first = groups_for(at + 1u, frame.tile_power - 1u);
            atomicMax(&work.first_x, min(first, GROUPS_A_ROW));
            atomicMax(&work.first_y, (first - 1u) / GROUPS_A_ROW + 1u);
            atomicMax(&work.first_z, 1u);
        }
        return;
    }
    // Nothing is seen, and no ray will be cast to say so.
    for (var i = 0u; i < side * side; i += 1u) {
        let at = tile * side + vec2<u32>(i % side, i / side);
        textureStore(picture, at, eye, vec4<f32>(0.0));
        textureStore(depth_mm, at, eye, vec4<f32>(0.0));
        if (SPREAD) {
            textureStore(first_picture, at / 2u, eye, vec4<f32>(0.0));
            textureStore(first_depth_mm, at / 2u, eye, vec4<f32>(0.0));
        }
    }
}
