// One ray a pixel, both eyes in one dispatch: colour multiplied by opacity, opacity, and depth in millimetres.
// docs/picture.md says what is computed; this says how.

override MODE: u32 = 0u;
override LIT: bool = false;
// Whether some cells are empty.
override SKIP: bool = true;

const EMISSION_ABSORPTION: u32 = 0u;
const THRESHOLD: u32 = 1u;
const X_RAY: u32 = 2u;
const MAXIMUM: u32 = 3u;
const CUMULATED: u32 = 4u;

// Steps of the Illinois method when a crossing is refined. Where the field is straight one suffices; bends between voxels
// take a few.
const REFINEMENTS: i32 = 7;

// Cells between a cell and the nearest one with something in it; 0: this one.
@group(2) @binding(0) var distance_to_seen: texture_3d<u32>;
// Colour (not multiplied) and opacity of one step, by value. Tables are textures: a software driver reads a filtered
// texel in a fifth of the time that it takes for as many numbers from a buffer.
@group(2) @binding(1) var table: texture_1d<f32>;
@group(2) @binding(2) var table_sampler: sampler;
// Extinction a millimetre, by value: for the one sample that stands for less than a step.
@group(2) @binding(3) var<storage, read> extinction: array<f32>;
// Highest value in each cell and a border voxel around it.
@group(2) @binding(5) var cell_maximum: texture_3d<f32>;

// A layer an eye.
@group(3) @binding(0) var picture: texture_storage_2d_array<rgba32float, write>;
@group(3) @binding(1) var depth_mm: texture_storage_2d_array<r32float, write>;
// A layer an eye: in which chunks of depth a tile may see something.
@group(3) @binding(2) var masks: texture_2d_array<u32>;

// What is to be cast, as an indirect dispatch takes it: workgroups of 64 rays each, of all pixels or of listed ones, and where
// a ray of every other pixel of every other row is cast.
struct Work {
    groups: vec3<u32>,
    tile_count: u32,
    first_groups: vec3<u32>,
    tiles: array<u32>,
}

@group(3) @binding(3) var<storage, read> work: Work;

// Which rays are cast: of each pixel of the listed tiles; of every other pixel of every other row of them; of listed pixels.
override RAYS: u32 = 0u;

const EACH: u32 = 0u;
const FIRST: u32 = 1u;
const LISTED: u32 = 2u;

// Farther than any volume reaches, in millimetres, and finite.
const FAR: f32 = 3.0e38;

struct Ray {
    // t is millimetres along the ray from the anchor; the eye lies at t = -eye_distance_mm.
    anchor: vec3<f32>,
    per_mm: vec3<f32>,
    // Its reciprocal, with components that are (nearly) zero held finite.
    mm_per: vec3<f32>,
    direction_mm: vec3<f32>,
    enter_mm: f32,
    leave_mm: f32,
    eye_distance_mm: f32,
    // Where the first chunk begins, and how long one is, from the anchor along this ray.
    chunks_begin_mm: f32,
    chunk_mm: f32,
    chunks: vec4<u32>,
}

struct Pixel {
    // Multiplied by opacity.
    color: vec3<f32>,
    opacity: f32,
    // From the anchor; meaningful if has_depth.
    depth_mm: f32,
    has_depth: bool,
}

fn ray_of(eye: u32, pixel: vec2<u32>) -> Ray {
    let e = frame.eyes[eye];
    let xy = (vec2<f32>(pixel) + 0.5) / vec2<f32>(frame.render_size) - 0.5;
    let direction = e.ray + xy.x * e.ray_dx + xy.y * e.ray_dy;
    let direction_mm = e.ray_mm + xy.x * e.ray_dx_mm + xy.y * e.ray_dy_mm;
    let mm = length(direction_mm);
    var ray: Ray;
    ray.anchor = e.anchor + e.anchor_depth * (xy.x * e.ray_dx + xy.y * e.ray_dy);
    ray.per_mm = direction / mm;
    ray.direction_mm = direction_mm / mm;
    ray.eye_distance_mm = e.anchor_depth * mm;
    // A ray parallel to a face never meets it: a huge but finite reciprocal says so without relying on infinity.
    let least = 1.0e-12 * max(max(abs(ray.per_mm.x), abs(ray.per_mm.y)), abs(ray.per_mm.z));
    let held = select(ray.per_mm, select(vec3<f32>(-least), vec3<f32>(least), ray.per_mm >= vec3<f32>(0.0)),
        abs(ray.per_mm) < vec3<f32>(least));
    ray.mm_per = 1.0 / held;
    let a = (vec3<f32>(-0.5) - ray.anchor) * ray.mm_per;
    let b = (frame.dims - 0.5 - ray.anchor) * ray.mm_per;
    // A ray in a face has no way to that face: it is inside.
    let is_parallel = abs(ray.per_mm) < vec3<f32>(least);
    let is_between = (ray.anchor >= vec3<f32>(-0.5)) & (ray.anchor <= frame.dims - 0.5);
    let endless = select(vec3<f32>(-FAR), vec3<f32>(FAR), is_between);
    let near = select(min(a, b), -endless, is_parallel);
    let far = select(max(a, b), endless, is_parallel);
    ray.enter_mm = max(max(max(near.x, near.y), near.z), -ray.eye_distance_mm);
    ray.leave_mm = min(min(far.x, far.y), far.z);
    ray.chunks_begin_mm = (e.near - e.anchor_depth) * mm;
    ray.chunk_mm = chunk_depth(e) * mm;
    ray.chunks = textureLoad(masks, pixel >> vec2<u32>(frame.tile_power), eye, 0);
    return ray;
}

fn at(ray: Ray, t_mm: f32) -> vec3<f32> {
    return ray.anchor + ray.per_mm * t_mm;
}

// Entries of the tables.
override ENTRIES: f32 = 4094.0;
// Where the entries for a part of a step begin; an entry of margin lies on either side of the border.
const OF_PARTS: f32 = 4096.0;
const TABLE_WIDTH: f32 = 8192.0;

fn table_position(raw: f32) -> f32 {
    return clamp(raw * frame.table_scale + frame.table_offset, 0.0, ENTRIES - 1.0);
}

// Colour and opacity of a step, or of a part of one, from the table.
fn optical(raw: f32, in_parts: bool) -> vec4<f32> {
    let u = table_position(raw);
    let begin = select(0.0, OF_PARTS, in_parts);
    if (EXACT_FILTER) {
        let i = min(floor(u), ENTRIES - 2.0);
        let entry = i32(begin + i);
        return mix(textureLoad(table, entry, 0), textureLoad(table, entry + 1, 0), u - i);
    }
    return textureSampleLevel(table, table_sampler, (begin + u + 0.5) / TABLE_WIDTH, 0.0);
}

fn extinction_per_mm(raw: f32) -> f32 {
    let u = table_position(raw);
    let i = min(u32(u), u32(ENTRIES) - 2u);
    return mix(extinction[i], extinction[i + 1u], u - f32(i));
}

// 1 - exp(-x), with the digits of a small x.
fn opacity_of(optical_depth: f32) -> f32 {
    if (optical_depth < 0.03) {
        return optical_depth * (1.0 - optical_depth * (0.5 - optical_depth * (0.16666667 - optical_depth * 0.041666667)));
    }
    return 1.0 - exp(-optical_depth);
}

// Samples along a ray, `step` apart; number i may be a fraction.
struct Lattice {
    // In voxels.
    first: vec3<f32>,
    step: vec3<f32>,
    // The same as the filter takes them.
    first_texel: vec3<f32>,
    step_texel: vec3<f32>,
    // The chunk c begins at the sample with the number chunk_first + c * chunk_step, or before it.
    chunk_first: f32,
    chunk_step: f32,
}

fn lattice(ray: Ray, first_mm: f32, step_mm: f32) -> Lattice {
    var l: Lattice;
    l.first = at(ray, first_mm);
    l.step = ray.per_mm * step_mm;
    let per_dim = 1.0 / frame.dims;
    l.first_texel = (l.first + 0.5) * per_dim;
    l.step_texel = l.step * per_dim;
    l.chunk_first = (ray.chunks_begin_mm - first_mm) / step_mm;
    l.chunk_step = ray.chunk_mm / step_mm;
    return l;
}

fn place(l: Lattice, i: f32) -> vec3<f32> {
    return l.first + i * l.step;
}

fn sample(l: Lattice, i: f32) -> f32 {
    if (COUNT) {
        counted.samples += 1u;
    }
    if (EXACT_FILTER) {
        return raw_at(place(l, i));
    }
    return textureSampleLevel(voxels, voxel_sampler, l.first_texel + i * l.step_texel, 0.0).r;
}

// The first sample in or behind a chunk, of `count` that there are.
fn first_in(l: Lattice, chunk: u32, count: f32) -> f32 {
    let i = clamp(ceil(l.chunk_first + f32(chunk) * l.chunk_step), 0.0, count);
    return select(i, count, chunk >= CHUNKS);
}

// The last sample before a chunk or at its beginning.
fn last_before(l: Lattice, chunk: u32, count: f32) -> f32 {
    return clamp(floor(l.chunk_first + f32(chunk) * l.chunk_step), 0.0, count);
}

// What a ray has gathered on its way.
struct Gathered {
    color: vec3<f32>,
    // Summed, not taken from a product of transmittances: a thousandth of a fog's step is less than float32 tells from 1.
    opacity: f32,
    // The piece in which half of the light was gone: where it begins and how long it is, in steps, and the transmittance
    // before it and behind it.
    half_i: f32,
    half_length: f32,
    half_before: f32,
    half_after: f32,
}

// Adds matter of `weight` behind what is in front; colour is added by who knows its light.
fn gather(sum: ptr<function, Gathered>, weight: f32, i: f32, length: f32) {
    if (COUNT) {
        counted.contributed += u32(weight > 0.0);
    }
    let transmittance = 1.0 - (*sum).opacity;
    let before = (*sum).opacity < 0.5;
    (*sum).half_i = select((*sum).half_i, i, before);
    (*sum).half_length = select((*sum).half_length, length, before);
    (*sum).half_before = select((*sum).half_before, transmittance, before);
    (*sum).half_after = select((*sum).half_after, transmittance - weight, before);
    (*sum).opacity += weight;
}

// How a ray goes on: in whole steps from a point of the lattice to the next while there is little to see, and in parts of a
// step where there is more.
const WHOLE: u32 = 0u;
const PARTS: u32 = 1u;
// Behind matter: looks at the point it stands on, from where it goes on in whole steps.
const LOOK: u32 = 2u;

struct March {
    // In steps from the first point; between points of the lattice only while in parts.
    i: f32,
    pace: u32,
    // Colour multiplied by opacity, and opacity, that a step would have with the value at i.
    here: vec4<f32>,
}

// One sample and what follows from it: the weighted colour, not lit, and the weight of the piece that was gone.
fn go_on(m: ptr<function, March>, l: Lattice, sum: ptr<function, Gathered>) -> vec4<f32> {
    let in_parts = (*m).pace == PARTS;
    let looks = (*m).pace == LOOK;
    let length = select(1.0, frame.part, in_parts);
    let ahead = select(length, 0.5 * length, in_parts);
    let o = optical(sample(l, (*m).i + select(ahead, 0.0, looks)), in_parts);
    let matter = vec4<f32>(o.rgb * o.a, o.a);
    // A step with more than little to see at either end is gone again, in parts.
    let again = (*m).pace == WHOLE && max(o.a, (*m).here.a) > frame.little;
    let stays = again || looks;
    let whole = 0.5 * (matter + (*m).here);
    let piece = select(select(whole, matter, in_parts), vec4<f32>(0.0), stays) * (1.0 - (*sum).opacity);
    gather(sum, piece.a, (*m).i, length);
    let i = (*m).i + select(length, 0.0, stays);
    let ends = in_parts && i == floor(i) && o.a <= frame.little * frame.part;
    (*m).i = i;
    (*m).here = select((*m).here, matter, !in_parts && !again);
    (*m).pace = select(select(WHOLE, PARTS, in_parts || again), LOOK, ends);
    return piece;
}

// Weighted colour and weight of pieces that are lit alike, as at p.
fn lit_together(piece: vec4<f32>, p: vec3<f32>, ray: Ray) -> vec3<f32> {
    let cosine = facing(p, ray.direction_mm);
    return piece.rgb * (frame.light.x + frame.light.y * cosine) + piece.a * mirrored(cosine);
}

// Loops here hold only what every sample needs. A software driver, and a GPU whose rays part ways, runs all of a loop's
// body for all rays of a group as long as one of them goes on: light, crossings and the last, shorter step stand outside.
fn emission_absorption(ray: Ray) -> Pixel {
    let way = ray.leave_mm - ray.enter_mm;
    let whole = max(floor(way / frame.step_mm), 0.0);
    let l = lattice(ray, ray.enter_mm, frame.step_mm);
    let enough = 1.0 - frame.least_transmittance;
    var sum = Gathered(vec3<f32>(0.0), 0.0, 0.0, 1.0, 1.0, 1.0);
    var m = March(0.0, LOOK, vec4<f32>(0.0));
    var end = -1.0;
    var chunk = 0u;
    loop {
        let run = run_from(ray.chunks, chunk);
        if (run.x >= CHUNKS || sum.opacity > enough) {
            break;
        }
        chunk = run.y;
        // What was left out holds nothing to be seen, its points on the lattice neither.
        let first = last_before(l, run.x, whole);
        if (first > m.i) {
            m = March(first, WHOLE, vec4<f32>(0.0));
        }
        end = first_in(l, run.y, whole);
        if (LIT) {
            loop {
                if (m.i >= end || sum.opacity > enough) {
                    break;
                }
                // Pieces that are lit alike, from the first with something to see: until they have weight, or until they
                // are far apart.
                var color = vec4<f32>(0.0);
                var moment = 0.0;
                var until = end;
                loop {
                    if (m.i >= until || sum.opacity > enough) {
                        break;
                    }
                    let begin = floor(m.i);
                    let at = m.i;
                    let piece = go_on(&m, l, &sum);
                    until = select(until, min(begin + frame.light_span, end), color.a <= 0.0 && piece.a > 0.0);
                    color += piece;
                    moment += piece.a * 0.5 * (at + m.i);
                    until = select(until, m.i, color.a > frame.light_weight);
                }
                if (color.a > 0.0) {
                    sum.color += lit_together(color, place(l, moment / color.a), ray);
                }
            }
        } else {
            loop {
                if (m.i >= end || sum.opacity > enough) {
                    break;
                }
                sum.color += go_on(&m, l, &sum).rgb;
            }
        }
    }
    // What is left of the way: less than a step.
    let rest = max(way / frame.step_mm - whole, 0.0);
    if (end >= whole && rest > 0.0 && sum.opacity <= enough) {
        let length = rest * frame.part;
        for (var i = 0.5; i * frame.part < 1.0; i += 1.0) {
            let at = whole + i * length;
            let raw = sample(l, at);
            let weight = (1.0 - sum.opacity) * opacity_of(extinction_per_mm(raw) * length * frame.step_mm);
            let piece = weight * vec4<f32>(optical(raw, false).rgb, 1.0);
            gather(&sum, weight, at - 0.5 * length, length);
            if (LIT && weight > 0.0) {
                sum.color += lit_together(piece, place(l, at), ray);
            } else {
                sum.color += piece.rgb;
            }
        }
    }

    var out = Pixel(sum.color, sum.opacity, 0.0, sum.opacity >= 0.5);
    if (out.has_depth) {
        // Within a piece light falls exponentially.
        let whole_fall = log(sum.half_before / max(sum.half_after, 1.0e-30));
        let part = clamp(log(2.0 * sum.half_before) / whole_fall, 0.0, 1.0);
        out.depth_mm = ray.enter_mm + (sum.half_i + part * sum.half_length) * frame.step_mm;
    }
    return out;
}

// Where the value first reaches the threshold; has_depth says whether it does.
fn first_crossing(ray: Ray) -> Pixel {
    var out = Pixel(vec3<f32>(0.0), 0.0, 0.0, false);
    let way = ray.leave_mm - ray.enter_mm;
    // Samples on the lattice; the end of the way, which is not on it, is looked at behind them.
    let count = max(ceil(way / frame.step_mm), 0.0);
    let l = lattice(ray, ray.enter_mm, frame.step_mm);
    var hit = count;
    var chunk = 0u;
    loop {
        let run = run_from(ray.chunks, chunk);
        if (run.x >= CHUNKS || out.has_depth) {
            break;
        }
        chunk = run.y;
        var i = first_in(l, run.x, count);
        let end = first_in(l, run.y, count);
        loop {
            if (i >= end) {
                break;
            }
            if (sample(l, i) * frame.value_scale + frame.value_offset >= frame.threshold) {
                hit = i;
                out.has_depth = true;
                break;
            }
            i += 1.0;
        }
    }
    if (!out.has_depth && value_at(at(ray, ray.leave_mm)) >= frame.threshold) {
        out.has_depth = true;
    }
    // The crossing lies between these two samples: the one before is below the threshold, seen or in an empty cell.
    var low = ray.enter_mm + max(hit - 1.0, 0.0) * frame.step_mm;
    var high = min(ray.enter_mm + hit * frame.step_mm, ray.leave_mm);
    // Regula falsi with Illinois' halving, kept between the two samples. The condition on has_depth ends the loop at once
    // for groups of rays that meet nothing.
    var below = value_at(at(ray, low)) - frame.threshold;
    var above = value_at(at(ray, high)) - frame.threshold;
    var weight_below = 1.0;
    var weight_above = 1.0;
    for (var k = 0; k < REFINEMENTS && out.has_depth && high > low && below < 0.0; k += 1) {
        let part = below * weight_below / (below * weight_below - above * weight_above);
        let middle = low + (high - low) * clamp(part, 0.0, 1.0);
        let f = value_at(at(ray, middle)) - frame.threshold;
        // An end that stays twice weighs half, so that the other one cannot creep up to the crossing alone.
        if (f >= 0.0) {
            high = middle;
            above = f;
            weight_above = 1.0;
            weight_below *= 0.5;
        } else {
            low = middle;
            below = f;
            weight_below = 1.0;
            weight_above *= 0.5;
        }
    }
    if (!out.has_depth) {
        return out;
    }
    if (below < 0.0 && above > 0.0) {
        high = low + (high - low) * (below / (below - above));
    }
    if (COUNT) {
        counted.contributed += 1u;
    }
    out.depth_mm = high;
    out.opacity = frame.surface_opacity;
    out.color = lit(frame.surface_color, facing(at(ray, high), ray.direction_mm)) * out.opacity;
    return out;
}

fn x_ray(ray: Ray) -> Pixel {
    let way = ray.leave_mm - ray.enter_mm;
    // Equal steps, no longer than asked for, so that the mean needs no weights.
    let n = max(ceil(way / frame.step_mm), 1.0);
    let step = way / n;
    let l = lattice(ray, ray.enter_mm + 0.5 * step, step);
    // Two sums: a float32 sum of 100 000 terms alone would lose the digits of each.
    var sum = 0.0;
    var part = 0.0;
    for (var i = 0u; i < u32(n); i += 1u) {
        part += sample(l, f32(i));
        if ((i & 255u) == 255u) {
            sum += part;
            part = 0.0;
        }
    }
    if (COUNT) {
        counted.contributed += u32(n);
    }
    let mean = (sum + part) / n * frame.value_scale + frame.value_offset;
    let grey = clamp((mean - frame.window_low) * frame.window_per_value, 0.0, 1.0);
    return Pixel(vec3<f32>(grey), grey, 0.5 * (ray.enter_mm + ray.leave_mm), true);
}

fn maximum(ray: Ray) -> Pixel {
    let way = ray.leave_mm - ray.enter_mm;
    let count = max(ceil(way / frame.step_mm), 0.0);
    let l = lattice(ray, ray.enter_mm, frame.step_mm);
    let samples_per = ray.mm_per / frame.step_mm;
    var best = sample(l, 0.0) * frame.value_scale + frame.value_offset;
    var best_mm = ray.enter_mm;
    var i = 1.0;
    loop {
        // Where a cell holds more than was found.
        var end = count;
        if (SKIP) {
            end = i;
            loop {
                if (i >= count) {
                    break;
                }
                let p = place(l, i);
                let cell = cell_of(p, MAXIMUM_CELL);
                end = i + max(ceil(way_out(p, cell, MAXIMUM_CELL, 0, samples_per)), 1.0);
                if (frame.skip_empty == 0u || textureLoad(cell_maximum, cell, 0).r > best) {
                    break;
                }
                i = end;
            }
            end = min(end, count);
        }
        if (i >= count) {
            break;
        }
        loop {
            if (i >= end) {
                break;
            }
            let value = sample(l, i) * frame.value_scale + frame.value_offset;
            if (value > best) {
                if (COUNT) {
                    counted.contributed += 1u;
                }
                best = value;
                best_mm = ray.enter_mm + i * frame.step_mm;
            }
            i += 1.0;
        }
    }
    // The end of the way is not on the lattice.
    let at_end = value_at(at(ray, ray.leave_mm));
    if (at_end > best) {
        best = at_end;
        best_mm = ray.leave_mm;
    }
    // The peak lies between the samples beside the best one.
    let best_i = (best_mm - ray.enter_mm) / frame.step_mm;
    for (var off = frame.part; off < 1.0; off += frame.part) {
        for (var side = -1.0; side < 2.0; side += 2.0) {
            let i = clamp(best_i + side * off, 0.0, way / frame.step_mm);
            let value = sample(l, i) * frame.value_scale + frame.value_offset;
            if (value > best) {
                best = value;
                best_mm = ray.enter_mm + i * frame.step_mm;
            }
        }
    }
    // The table's opacity is that of the transfer function itself in this mode.
    let raw = (best - frame.value_offset) / frame.value_scale;
    let o = optical(raw, false);
    return Pixel(o.rgb * o.a, o.a, best_mm, true);
}

fn surface_over(front: Pixel, behind: Pixel) -> Pixel {
    var out = front;
    out.color += (1.0 - out.opacity) * behind.color;
    out.opacity += (1.0 - out.opacity) * behind.opacity;
    if (!out.has_depth) {
        out.depth_mm = behind.depth_mm;
        out.has_depth = true;
    }
    return out;
}

// The pixel that an invocation casts the ray of.
struct Own {
    pixel: vec2<u32>,
    // Where in the picture that is written it goes.
    place: vec2<u32>,
    eye: u32,
    // Whether there is such a pixel.
    is_valid: bool,
}

// A workgroup casts 64 rays: of listed tiles, or of listed pixels.
fn own_pixel(group: vec3<u32>, index: u32) -> Own {
    if (RAYS == LISTED) {
        let listed = (group.y * GROUPS_A_ROW + group.x) * 64u + index;
        let number = work.tiles[min(listed, work.tile_count - 1u)];
        let pixel = tile_of(number);
        return Own(pixel, pixel, tile_eye(number), listed < work.tile_count && all(pixel < frame.render_size));
    }
    let is_first = RAYS == FIRST;
    let ray = listed_ray(group, index, frame.tile_power - select(0u, 1u, is_first));
    let number = work.tiles[min(ray.tile, work.tile_count - 1u)];
    // Of rays that are cast first, the pixel among those.
    let place = ((tile_of(number) << vec2<u32>(frame.tile_power)) >> vec2<u32>(select(0u, 1u, is_first))) + ray.inside;
    let pixel = place << vec2<u32>(select(0u, 1u, is_first));
    let is_valid = ray.tile < work.tile_count && all(pixel < frame.render_size);
    return Own(pixel, select(place, pixel, COUNT), tile_eye(number), is_valid);
}

@compute @workgroup_size(64)
fn raycast(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let own = own_pixel(group, index);
    if (!own.is_valid) {
        return;
    }
    let ray = ray_of(own.eye, own.pixel);
    var out = Pixel(vec3<f32>(0.0), 0.0, 0.0, false);
    if (ray.leave_mm > ray.enter_mm) {
        if (MODE == EMISSION_ABSORPTION) {
            out = emission_absorption(ray);
        } else if (MODE == THRESHOLD) {
            out = first_crossing(ray);
        } else if (MODE == X_RAY) {
            out = x_ray(ray);
        } else if (MODE == MAXIMUM) {
            out = maximum(ray);
        } else {
            out = surface_over(first_crossing(ray), x_ray(ray));
        }
    }
    store(out, ray, own);
}

fn store(out: Pixel, ray: Ray, own: Own) {
    if (COUNT) {
        let counts = vec4<f32>(f32(counted.samples), f32(counted.contributed), f32(counted.gradients), 1.0);
        textureStore(picture, own.place, own.eye, counts);
        return;
    }
    let depth = select(0.0, max(out.depth_mm + ray.eye_distance_mm, 1.0e-30), out.has_depth);
    textureStore(picture, own.place, own.eye, vec4<f32>(out.color, out.opacity));
    textureStore(depth_mm, own.place, own.eye, vec4<f32>(depth, 0.0, 0.0, 0.0));
}
