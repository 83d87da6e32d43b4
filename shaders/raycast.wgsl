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

// A layer an eye.
@group(3) @binding(0) var picture: texture_storage_2d_array<rgba32float, write>;
@group(3) @binding(1) var depth_mm: texture_storage_2d_array<r32float, write>;

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
    return ray;
}

fn at(ray: Ray, t_mm: f32) -> vec3<f32> {
    return ray.anchor + ray.per_mm * t_mm;
}

// Entries of the tables.
override ENTRIES: f32 = 4096.0;

fn table_position(raw: f32) -> f32 {
    return clamp(raw * frame.table_scale + frame.table_offset, 0.0, ENTRIES - 1.0);
}

// Colour and opacity of a step, from the table.
fn optical(raw: f32) -> vec4<f32> {
    let u = table_position(raw);
    if (EXACT_FILTER) {
        let i = min(i32(u), i32(ENTRIES) - 2);
        return mix(textureLoad(table, i, 0), textureLoad(table, i + 1, 0), u - f32(i));
    }
    return textureSampleLevel(table, table_sampler, (u + 0.5) / ENTRIES, 0.0);
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

// How many samples from i on, at step_mm from p, lie where nothing is to be seen; 0 if p itself may be seen.
fn skippable(ray: Ray, p: vec3<f32>) -> u32 {
    let cell = cell_of(p);
    let reach = textureLoad(distance_to_seen, cell, 0).r * frame.skip_empty;
    if (reach == 0u) {
        return 0u;
    }
    let out = way_out(p, cell, i32(reach) - 1, ray.mm_per);
    return u32(max(ceil(out / frame.step_mm), 1.0));
}

// What a ray has gathered on its way.
struct Gathered {
    color: vec3<f32>,
    // Summed, not taken from a product of transmittances: a thousandth of a fog's step is less than float32 tells from 1.
    opacity: f32,
    // The step in which half of the light was gone: its beginning and length, transmittance before and after.
    half_begin_mm: f32,
    half_length_mm: f32,
    half_before: f32,
    half_after: f32,
}

fn gather(before: Gathered, color: vec3<f32>, opacity: f32, begin_mm: f32, length_mm: f32) -> Gathered {
    let transmittance = 1.0 - before.opacity;
    var after = before;
    after.color += transmittance * opacity * color;
    after.opacity += transmittance * opacity;
    if (before.opacity < 0.5 && after.opacity >= 0.5) {
        after.half_begin_mm = begin_mm;
        after.half_length_mm = length_mm;
        after.half_before = transmittance;
        after.half_after = 1.0 - after.opacity;
    }
    return after;
}

// Loops here hold only what every sample needs. A software driver, and a GPU whose rays part ways, runs all of a loop's
// body for all rays of a group as long as one of them goes on: light, crossings and the last, shorter step stand outside.
fn emission_absorption(ray: Ray) -> Pixel {
    var sum = Gathered(vec3<f32>(0.0), 0.0, 0.0, 0.0, 1.0, 1.0);
    let way = ray.leave_mm - ray.enter_mm;
    let whole = u32(way / frame.step_mm);
    var i = 0u;
    loop {
        var seen = vec4<f32>(0.0);
        var seen_at = vec3<f32>(0.0);
        var begin = 0.0;
        loop {
            if (i >= whole || 1.0 - sum.opacity < frame.least_transmittance) {
                break;
            }
            begin = ray.enter_mm + f32(i) * frame.step_mm;
            let p = at(ray, begin + 0.5 * frame.step_mm);
            if (SKIP) {
                let n = skippable(ray, p);
                if (n > 0u) {
                    i += n;
                    continue;
                }
            }
            i += 1u;
            let o = optical(raw_at(p));
            if (o.a > 0.0) {
                if (LIT) {
                    seen = o;
                    seen_at = p;
                    break;
                }
                sum = gather(sum, o.rgb, o.a, begin, frame.step_mm);
            }
        }
        if (!LIT || seen.a <= 0.0) {
            break;
        }
        sum = gather(sum, lit(seen.rgb, facing(seen_at, ray.direction_mm)), seen.a, begin, frame.step_mm);
    }
    // The last sample stands for what is left of the way: less than a step.
    let rest_begin = ray.enter_mm + f32(whole) * frame.step_mm;
    let rest_mm = max(way - f32(whole) * frame.step_mm, 0.0);
    let p = at(ray, rest_begin + 0.5 * rest_mm);
    let raw = raw_at(p);
    let rest_opacity = opacity_of(extinction_per_mm(raw) * rest_mm);
    if (rest_opacity > 0.0 && 1.0 - sum.opacity >= frame.least_transmittance) {
        var color = optical(raw).rgb;
        if (LIT) {
            color = lit(color, facing(p, ray.direction_mm));
        }
        sum = gather(sum, color, rest_opacity, rest_begin, rest_mm);
    }

    var out = Pixel(sum.color, sum.opacity, 0.0, sum.opacity >= 0.5);
    if (out.has_depth) {
        // Within a step light falls exponentially.
        let whole_fall = log(sum.half_before / max(sum.half_after, 1.0e-30));
        let part = clamp(log(2.0 * sum.half_before) / whole_fall, 0.0, 1.0);
        out.depth_mm = sum.half_begin_mm + part * sum.half_length_mm;
    }
    return out;
}

// Where the value first reaches the threshold; has_depth says whether it does.
fn first_crossing(ray: Ray) -> Pixel {
    var out = Pixel(vec3<f32>(0.0), 0.0, 0.0, false);
    let way = ray.leave_mm - ray.enter_mm;
    let last = u32(ceil(way / frame.step_mm));
    var i = 0u;
    // The crossing lies between these two samples.
    var low = ray.enter_mm;
    var high = ray.enter_mm;
    loop {
        if (i > last) {
            break;
        }
        let t = min(ray.enter_mm + f32(i) * frame.step_mm, ray.leave_mm);
        let p = at(ray, t);
        if (SKIP) {
            let n = skippable(ray, p);
            if (n > 0u) {
                // The end of the way is always looked at: it is not on the lattice.
                i = select(min(i + n, last), last + 1u, i == last);
                // All samples passed over are below the threshold: the last of them bounds the crossing.
                low = ray.enter_mm + f32(max(i, 1u) - 1u) * frame.step_mm;
                continue;
            }
        }
        if (value_at(p) >= frame.threshold) {
            high = t;
            out.has_depth = true;
            break;
        }
        low = t;
        i += 1u;
    }
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
    // Two sums: a float32 sum of 100 000 terms alone would lose the digits of each.
    var sum = 0.0;
    var part = 0.0;
    for (var i = 0u; i < u32(n); i += 1u) {
        part += raw_at(at(ray, ray.enter_mm + (f32(i) + 0.5) * step));
        if ((i & 255u) == 255u) {
            sum += part;
            part = 0.0;
        }
    }
    let mean = (sum + part) / n * frame.value_scale + frame.value_offset;
    let grey = clamp((mean - frame.window_low) * frame.window_per_value, 0.0, 1.0);
    return Pixel(vec3<f32>(grey), grey, 0.5 * (ray.enter_mm + ray.leave_mm), true);
}

fn maximum(ray: Ray) -> Pixel {
    let way = ray.leave_mm - ray.enter_mm;
    let last = u32(ceil(way / frame.step_mm));
    var best = value_at(at(ray, ray.enter_mm));
    var best_mm = ray.enter_mm;
    var i = 1u;
    loop {
        if (i > last) {
            break;
        }
        let t = min(ray.enter_mm + f32(i) * frame.step_mm, ray.leave_mm);
        let p = at(ray, t);
        if (SKIP) {
            let cell = cell_of(p);
            if (frame.skip_empty != 0u && textureLoad(cell_maximum, cell, 0).r <= best) {
                let out = way_out(p, cell, 0, ray.mm_per);
                let n = u32(max(ceil(out / frame.step_mm), 1.0));
                i = select(min(i + n, last), last + 1u, i == last);
                continue;
            }
        }
        let value = value_at(p);
        if (value > best) {
            best = value;
            best_mm = t;
        }
        i += 1u;
    }
    // The table's opacity is that of the transfer function itself in this mode.
    let raw = (best - frame.value_offset) / frame.value_scale;
    let o = optical(raw);
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

// The 64 invocations of a group as 8 blocks of 4 by 2 pixels: what runs in step looks at neighbouring rays.
fn pixel_in_group(index: u32) -> vec2<u32> {
    let block = index >> 3u;
    let inside = index & 7u;
    return vec2<u32>((block & 1u) * 4u + (inside & 3u), (block >> 1u) * 2u + (inside >> 2u));
}

@compute @workgroup_size(64)
fn raycast(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let pixel = group.xy * 8u + pixel_in_group(index);
    let eye = group.z;
    if (pixel.x >= frame.render_size.x || pixel.y >= frame.render_size.y) {
        return;
    }
    let ray = ray_of(eye, pixel);
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
    store(out, ray, pixel, eye);
}

fn store(out: Pixel, ray: Ray, pixel: vec2<u32>, eye: u32) {
    let depth = select(0.0, max(out.depth_mm + ray.eye_distance_mm, 1.0e-30), out.has_depth);
    textureStore(picture, pixel, eye, vec4<f32>(out.color, out.opacity));
    textureStore(depth_mm, pixel, eye, vec4<f32>(depth, 0.0, 0.0, 0.0));
}
