// As tiles.wgsl, for several volumes: where along the depth a tile's rays may see something of each of them.

struct Work {
    // Workgroups to cast, as an indirect dispatch takes them.
    groups_x: atomic<u32>,
    groups_y: atomic<u32>,
    groups_z: atomic<u32>,
    tile_count: atomic<u32>,
    // The same for workgroups that cast four tiles.
    first_x: atomic<u32>,
    first_y: atomic<u32>,
    first_z: atomic<u32>,
    tiles: array<u32>,
}

// A layer an eye and part: the mask of chunks.
@group(3) @binding(0) var masks: texture_storage_2d_array<rgba32uint, write>;
@group(3) @binding(1) var<storage, read_write> work: Work;
@group(3) @binding(2) var picture: texture_storage_2d_array<rgba32float, write>;
@group(3) @binding(3) var depth_mm: texture_storage_2d_array<r32float, write>;

const FAR_AWAY: f32 = 1.0e30;

// Where a + s * b is above 0: the least s if b is above 0, the greatest if below.
fn root(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    let least = vec3<f32>(1.0e-30);
    return -a / select(b, select(-least, least, b >= vec3<f32>(0.0)), abs(b) < least);
}

// A tile's rays: depth s is counted from the anchor, the middle of the beam is at `anchor + s * direction`, and it reaches
// `margin + s * spread` to each side.
struct Beam {
    anchor: vec3<f32>,
    direction: vec3<f32>,
    spread_x: vec3<f32>,
    spread_y: vec3<f32>,
    anchor_depth: f32,
    step: f32,
    // Where the first chunk begins, how long one is, and where the last one ends.
    first_depth: f32,
    chunk_depth: f32,
    last_depth: f32,
}

// In which chunks a beam may see something of a part.
#each
fn seen_of_$(beam: Beam) -> vec4<u32> {
    let part = parts[$];
    let anchor = own_point($u, beam.anchor);
    let direction = own_vector($u, beam.direction);
    let spread = abs(own_vector($u, beam.spread_x)) + abs(own_vector($u, beam.spread_y));
    // A step more: a sample lies as far off the lattice at a border.
    let margin = beam.anchor_depth * spread + CELL_MARGIN + beam.step * abs(direction);
    let upper = direction + spread;
    let lower = direction - spread;
    let enters = root(anchor + margin + 0.5, upper);
    let leaves = root(part.dims - 0.5 - anchor + margin, -lower);
    let near = max(select(vec3<f32>(-FAR_AWAY), enters, upper > vec3<f32>(0.0)),
        select(vec3<f32>(-FAR_AWAY), leaves, lower < vec3<f32>(0.0)));
    let far = min(select(vec3<f32>(FAR_AWAY), enters, upper < vec3<f32>(0.0)),
        select(vec3<f32>(FAR_AWAY), leaves, lower > vec3<f32>(0.0)));
    var s = max(max(near.x, near.y), max(near.z, beam.first_depth));
    let end = min(min(far.x, far.y), min(far.z, beam.last_depth));
    let depth = beam.chunk_depth;
    var mask = vec4<u32>(0u);
    var chunk = u32(clamp((s - beam.first_depth) / depth, 0.0, f32(CHUNKS - 1u)));
    loop {
        if (s > end || chunk >= CHUNKS) {
            break;
        }
        let p = anchor + s * direction;
        let reach_out = margin + s * spread;
        let cell = own_cell($u, p);
        let reach = i32(reach_of_$(cell));
        // The block of empty cells around this one. Beyond the volume there is nothing.
        let first_cell = cell - (reach - 1);
        let end_cell = cell + reach;
        let low = select(vec3<f32>(first_cell) * CELL, vec3<f32>(-FAR_AWAY), first_cell <= vec3<i32>(0));
        let high = select(vec3<f32>(end_cell) * CELL, vec3<f32>(FAR_AWAY), end_cell >= vec3<i32>(part.cells));
        let below = p - reach_out - low;
        let above = high - p - reach_out;
        // How far on until the beam leaves the block, if it lies in it.
        let up = select(vec3<f32>(FAR_AWAY), above / upper, upper > vec3<f32>(0.0));
        let down = select(vec3<f32>(FAR_AWAY), below / -lower, lower < vec3<f32>(0.0));
        let on = min(min(min(up.x, up.y), up.z), min(min(down.x, down.y), down.z));
        let inside = reach > 0 && all(below > vec3<f32>(0.0)) && all(above > vec3<f32>(0.0));
        if (inside && on > 0.25 * depth) {
            s += on;
            chunk = max(chunk, u32(clamp((s - beam.first_depth) / depth, 0.0, f32(CHUNKS))));
        } else {
            mask |= bits_from(vec4<i32>(i32(chunk)) - WORD_BEGINS) & ~bits_from(vec4<i32>(i32(chunk + 1u)) - WORD_BEGINS);
            chunk += 1u;
            s = beam.first_depth + f32(chunk) * depth;
        }
    }
    return mask;
}
#end

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
    let half_tile = 0.5 * (opposite - corner) * pixel;
    var beam: Beam;
    beam.anchor = e.anchor + e.anchor_depth * (xy.x * e.ray_dx + xy.y * e.ray_dy);
    beam.direction = e.ray + xy.x * e.ray_dx + xy.y * e.ray_dy;
    beam.spread_x = half_tile.x * e.ray_dx;
    beam.spread_y = half_tile.y * e.ray_dy;
    beam.anchor_depth = e.anchor_depth;
    beam.step = frame.step_mm / length(e.ray_mm + xy.x * e.ray_dx_mm + xy.y * e.ray_dy_mm);
    beam.first_depth = e.near - e.anchor_depth;
    beam.chunk_depth = chunk_depth(e);
    beam.last_depth = e.far - e.anchor_depth;
    var mask = vec4<u32>(0u);
#each
    let mask_$ = seen_of_$(beam);
    textureStore(masks, tile, eye * PARTS + $u, mask_$);
    mask |= mask_$;
#end
    if (any(mask != vec4<u32>(0u))) {
        let at = atomicAdd(&work.tile_count, 1u);
        work.tiles[at] = tile_number(tile, eye);
        let groups = groups_for(at + 1u, frame.tile_power);
        atomicMax(&work.groups_x, min(groups, GROUPS_A_ROW));
        atomicMax(&work.groups_y, (groups - 1u) / GROUPS_A_ROW + 1u);
        atomicMax(&work.groups_z, 1u);
        return;
    }
    // Nothing is seen, and no ray will be cast to say so.
    for (var i = 0u; i < side * side; i += 1u) {
        let at = tile * side + vec2<u32>(i % side, i / side);
        textureStore(picture, at, eye, vec4<f32>(0.0));
        textureStore(depth_mm, at, eye, vec4<f32>(0.0));
    }
}
