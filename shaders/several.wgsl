// Emission and absorption of several volumes in one: extinctions add, and so does the light that each gives off, so that
// their order does not matter. Each is looked at on its own grid. What follows `#each` and `#sets` is explained in
// common/several.wgsl and below.

// Interpolate in float32 from eight fetched voxels instead of trusting the filtering unit.
override EXACT_FILTER: bool = false;
// Entries of the tables.
override ENTRIES: f32 = 4094.0;

@group(1) @binding(5) var voxel_sampler: sampler;
@group(2) @binding(8) var table_sampler: sampler;
// Those of each part in the order of values, or of labels, one part behind the other.
@group(2) @binding(9) var<storage, read> stretches: array<Stretch>;

// A layer an eye.
@group(3) @binding(0) var picture: texture_storage_2d_array<rgba32float, write>;
@group(3) @binding(1) var depth_mm: texture_storage_2d_array<r32float, write>;
// A layer an eye and part: in which chunks of depth a tile may see something of it.
@group(3) @binding(2) var masks: texture_2d_array<u32>;

struct Work {
    groups: vec3<u32>,
    tile_count: u32,
    first_groups: vec3<u32>,
    tiles: array<u32>,
}

@group(3) @binding(3) var<storage, read> work: Work;

// Farther than any volume reaches, in millimetres or steps, with room for products.
const FAR: f32 = 1.0e30;
// The opacity of a pixel whose ray was not followed to its end; exact.wgsl says when.
const UNFINISHED: f32 = -1.0;
// No label.
const NO_LABEL: u32 = 0xffffffffu;

// A ray in one part's own index space. t is millimetres along the ray from the anchor, the same in all parts.
struct Own {
    anchor: vec3<f32>,
    per_mm: vec3<f32>,
    // Its reciprocal, with components that are (nearly) zero held finite.
    mm_per: vec3<f32>,
    // From FAR to -FAR if it passes by.
    enter_mm: f32,
    leave_mm: f32,
}

struct Ray {
    direction_mm: vec3<f32>,
    // From where to where some part is.
    enter_mm: f32,
    leave_mm: f32,
    // The eye lies at t = -eye_distance_mm.
    eye_distance_mm: f32,
    chunks_begin_mm: f32,
    chunk_mm: f32,
}

struct Pixel {
    // Multiplied by opacity.
    color: vec3<f32>,
    opacity: f32,
    // From the anchor; meaningful if has_depth.
    depth_mm: f32,
    has_depth: bool,
}

fn own_ray(k: u32, anchor: vec3<f32>, per_mm: vec3<f32>, eye_distance_mm: f32) -> Own {
    var own: Own;
    own.anchor = own_point(k, anchor);
    own.per_mm = own_vector(k, per_mm);
    // A ray parallel to a face never meets it: a huge but finite reciprocal says so without relying on infinity.
    let least = 1.0e-12 * max(max(abs(own.per_mm.x), abs(own.per_mm.y)), abs(own.per_mm.z));
    let is_parallel = abs(own.per_mm) < vec3<f32>(least);
    let held = select(own.per_mm, select(vec3<f32>(-least), vec3<f32>(least), own.per_mm >= vec3<f32>(0.0)), is_parallel);
    own.mm_per = 1.0 / held;
    let most = parts[k].dims - 0.5;
    let a = (vec3<f32>(-0.5) - own.anchor) * own.mm_per;
    let b = (most - own.anchor) * own.mm_per;
    // A ray in a face has no way to that face: it is inside.
    let is_between = (own.anchor >= vec3<f32>(-0.5)) & (own.anchor <= most);
    let endless = select(vec3<f32>(-FAR), vec3<f32>(FAR), is_between);
    let near = select(min(a, b), -endless, is_parallel);
    let far = select(max(a, b), endless, is_parallel);
    own.enter_mm = max(max(max(near.x, near.y), near.z), -eye_distance_mm);
    own.leave_mm = min(min(far.x, far.y), far.z);
    if (own.leave_mm <= own.enter_mm) {
        own.enter_mm = FAR;
        own.leave_mm = -FAR;
    }
    return own;
}

#each
@group(1) @binding($VOXELS) var voxels_$: texture_3d<f32>;
// Colour (not multiplied) and extinction a millimetre, by value, or by label where they have room in it: a software driver
// reads a texel in less time than as many numbers from a buffer.
@group(2) @binding($TABLE) var table_$: texture_1d<f32>;
var<private> own_$: Own;
#end

fn ray_of(eye: u32, pixel: vec2<u32>) -> Ray {
    let e = frame.eyes[eye];
    let xy = (vec2<f32>(pixel) + 0.5) / vec2<f32>(frame.render_size) - 0.5;
    let direction_mm = e.ray_mm + xy.x * e.ray_dx_mm + xy.y * e.ray_dy_mm;
    let mm = length(direction_mm);
    let anchor = e.anchor + e.anchor_depth * (xy.x * e.ray_dx + xy.y * e.ray_dy);
    let per_mm = (e.ray + xy.x * e.ray_dx + xy.y * e.ray_dy) / mm;
    var ray: Ray;
    ray.direction_mm = direction_mm / mm;
    ray.eye_distance_mm = e.anchor_depth * mm;
    ray.enter_mm = FAR;
    ray.leave_mm = -FAR;
#each
    own_$ = own_ray($u, anchor, per_mm, ray.eye_distance_mm);
    ray.enter_mm = min(ray.enter_mm, own_$.enter_mm);
    ray.leave_mm = max(ray.leave_mm, own_$.leave_mm);
#end
    ray.chunks_begin_mm = (e.near - e.anchor_depth) * mm;
    ray.chunk_mm = chunk_depth(e) * mm;
    return ray;
}

// Cosine between a gradient by own index, up to a common factor, and the ray; 0 where there is no gradient.
fn cosine_of(k: u32, g: vec3<f32>, direction_mm: vec3<f32>) -> f32 {
    let strongest = max(max(abs(g.x), abs(g.y)), abs(g.z));
    if (!(strongest > 0.0)) {
        return 0.0;
    }
    // Scaled first: the squares of differences of a float volume may be too small for float32.
    let n = (g / strongest) * mat3x3<f32>(parts[k].gradient_x, parts[k].gradient_y, parts[k].gradient_z);
    return cosine_between(n, direction_mm);
}

// The same, of a gradient in millimetres whose square float32 can hold.
fn cosine_between(n: vec3<f32>, direction_mm: vec3<f32>) -> f32 {
    let length_squared = dot(n, n);
    if (!(length_squared > 0.0)) {
        return 0.0;
    }
    return min(abs(dot(n, direction_mm)) * inverseSqrt(length_squared), 1.0);
}

fn mirrored(k: u32, cosine: f32) -> f32 {
    if (cosine > 0.0) {
        return parts[k].light.z * pow(cosine, parts[k].light.w);
    }
    return 0.0;
}

fn lit(k: u32, color: vec3<f32>, cosine: f32) -> vec3<f32> {
    return color * (parts[k].light.x + parts[k].light.y * cosine) + mirrored(k, cosine);
}

// 1 - exp(-x), with the digits of a small x.
fn opacity_of(optical_depth: f32) -> f32 {
    if (optical_depth < 0.03) {
        return optical_depth * (1.0 - optical_depth * (0.5 - optical_depth * (0.16666667 - optical_depth * 0.041666667)));
    }
    return 1.0 - exp(-optical_depth);
}

fn voxel_of(k: u32, p: vec3<f32>) -> vec3<i32> {
    return clamp(vec3<i32>(floor(p + 0.5)), vec3<i32>(0), vec3<i32>(parts[k].dims) - 1);
}

#each
fn at_$(t_mm: f32) -> vec3<f32> {
    return own_$.anchor + own_$.per_mm * t_mm;
}

fn fetched_$(p: vec3<i32>) -> f32 {
    return textureLoad(voxels_$, p, 0).r;
}

// The stored number itself. Integers come as parts of their range, rounded to float32: they are made whole again.
fn stored_$(p: vec3<i32>) -> f32 {
    let raw = fetched_$(clamp(p, vec3<i32>(0), vec3<i32>(parts[$].dims) - 1));
    return select(raw, round(raw * parts[$].stored.x) + parts[$].stored.y, parts[$].stored.x > 0.0);
}

// The stored value of a part at an own point, before slope and intercept.
fn raw_at_$(p: vec3<f32>) -> f32 {
    if (!EXACT_FILTER) {
        return textureSampleLevel(voxels_$, voxel_sampler, (p + 0.5) / parts[$].dims, 0.0).r;
    }
    let q = clamp(p, vec3<f32>(0.0), parts[$].dims - 1.0);
    let low = floor(q);
    let f = q - low;
    let a = vec3<i32>(low);
    let b = min(a + 1, vec3<i32>(parts[$].dims) - 1);
    let x00 = mix(fetched_$(vec3<i32>(a.x, a.y, a.z)), fetched_$(vec3<i32>(b.x, a.y, a.z)), f.x);
    let x10 = mix(fetched_$(vec3<i32>(a.x, b.y, a.z)), fetched_$(vec3<i32>(b.x, b.y, a.z)), f.x);
    let x01 = mix(fetched_$(vec3<i32>(a.x, a.y, b.z)), fetched_$(vec3<i32>(b.x, a.y, b.z)), f.x);
    let x11 = mix(fetched_$(vec3<i32>(a.x, b.y, b.z)), fetched_$(vec3<i32>(b.x, b.y, b.z)), f.x);
    return mix(mix(x00, x10, f.y), mix(x01, x11, f.y), f.z);
}

// Light that a millimetre gives off, and its extinction, from the table.
fn optical_$(raw: f32) -> vec4<f32> {
    let u = clamp(raw * parts[$].table_scale + parts[$].table_offset, 0.0, ENTRIES - 1.0);
    var o: vec4<f32>;
    if (EXACT_FILTER) {
        let i = min(i32(u), i32(ENTRIES) - 2);
        o = mix(textureLoad(table_$, i, 0), textureLoad(table_$, i + 1, 0), u - f32(i));
    } else {
        o = textureSampleLevel(table_$, table_sampler, (u + 0.5) / ENTRIES, 0.0);
    }
    return vec4<f32>(o.rgb * o.a, o.a);
}

// The cosine between the gradient and the ray.
fn facing_$(p: vec3<f32>, direction_mm: vec3<f32>) -> f32 {
    let g = vec3<f32>(
        raw_at_$(p + vec3<f32>(1.0, 0.0, 0.0)) - raw_at_$(p - vec3<f32>(1.0, 0.0, 0.0)),
        raw_at_$(p + vec3<f32>(0.0, 1.0, 0.0)) - raw_at_$(p - vec3<f32>(0.0, 1.0, 0.0)),
        raw_at_$(p + vec3<f32>(0.0, 0.0, 1.0)) - raw_at_$(p - vec3<f32>(0.0, 0.0, 1.0)),
    );
    return cosine_of($u, g, direction_mm);
}

fn label_at_$(voxel: vec3<i32>) -> u32 {
    return u32(stored_$(voxel));
}

// As labels.wgsl has them: how much of a label is at a point, and the cosine between that share's gradient and the ray.
fn share_at_$(p: vec3<f32>, label: u32) -> f32 {
    let q = clamp(p, vec3<f32>(0.0), parts[$].dims - 1.0);
    let low = floor(q);
    let f = q - low;
    let a = vec3<i32>(low);
    var share = 0.0;
    for (var i = 0u; i < 8u; i += 1u) {
        let c = corner(i);
        if (label_at_$(a + c) == label) {
            let weight = select(1.0 - f, f, c == vec3<i32>(1));
            share += weight.x * weight.y * weight.z;
        }
    }
    return share;
}

fn label_facing_$(p: vec3<f32>, label: u32, direction_mm: vec3<f32>) -> f32 {
    let x = vec3<f32>(1.0, 0.0, 0.0);
    let y = vec3<f32>(0.0, 1.0, 0.0);
    let z = vec3<f32>(0.0, 0.0, 1.0);
    let g = vec3<f32>(
        share_at_$(p + x, label) - share_at_$(p - x, label),
        share_at_$(p + y, label) - share_at_$(p - y, label),
        share_at_$(p + z, label) - share_at_$(p - z, label),
    );
    // Where a label is all around, as at the border of its volume, what is left of the differences is rounding.
    return select(cosine_of($u, g, direction_mm), 0.0, all(abs(g) < vec3<f32>(SHARE_ROUNDING)));
}

// Where the ray leaves a voxel.
fn voxel_end_$(voxel: vec3<i32>) -> f32 {
    let side = select(vec3<f32>(-0.5), vec3<f32>(0.5), own_$.mm_per > vec3<f32>(0.0));
    let plane_mm = (vec3<f32>(voxel) + side - own_$.anchor) * own_$.mm_per;
    return min(min(plane_mm.x, plane_mm.y), plane_mm.z);
}
#end

// How a ray goes on: in whole steps from a point of the lattice to the next while there is little to see, and in parts of a
// step where there is more.
struct March {
    // In steps from the first point; between points of the lattice only while in parts.
    i: f32,
    in_parts: bool,
    opacity: f32,
    // The piece in which half of the light was gone: where it begins and how long it is, in steps, and the transmittance
    // before it and behind it.
    half_i: f32,
    half_length: f32,
    half_before: f32,
    half_after: f32,
}

var<private> m: March;

#each
// What is left at the point where the march stands: light that a millimetre gives off, and its extinction.
var<private> here_$: vec4<f32>;
// What has been gathered of this part.
var<private> color_$: vec3<f32>;
// Of measured values that are lit together: colour by weight, not lit, and weight; weight by place; and the point of the
// lattice up to which they are.
var<private> together_$: vec4<f32>;
var<private> moment_$: f32;
var<private> until_$: f32;
// The label at that point, its weight that waits for light, and where its run begins.
var<private> label_$: u32;
var<private> waiting_$: f32;
var<private> run_mm_$: f32;
#end

#each
// Lights what was gathered together.
fn light_$(ray: Ray) {
    if (together_$.a > 0.0) {
        let cosine = facing_$(at_$(moment_$ / together_$.a), ray.direction_mm);
        color_$ += together_$.rgb * (parts[$].light.x + parts[$].light.y * cosine) + together_$.a * mirrored($u, cosine);
    }
    together_$ = vec4<f32>(0.0);
    moment_$ = 0.0;
    until_$ = FAR;
}

// Lights a run of a label as where the ray enters it.
fn light_run_$(ray: Ray) {
    if (waiting_$ >= 0.0) {
        let look = stretches[parts[$].first_stretch + label_$];
        let shown = lit($u, look.color_from, label_facing_$(at_$(run_mm_$), label_$, ray.direction_mm));
        color_$ += waiting_$ * shown;
        here_$ = vec4<f32>(shown * look.opacity_to, look.opacity_to);
    }
    waiting_$ = -1.0;
}
#end

// One for each set of volumes that a stretch of the way may show: each alone, and all of them. `%` is the set's name.
//
// Loops here hold only what every sample needs. A software driver, and a GPU whose rays part ways, runs all of a loop's
// body for all rays of a group as long as one of them goes on: light stands outside.
#sets
fn march_%(ray: Ray, end: f32) {
    let step = frame.step_mm;
    let enough = 1.0 - frame.least_transmittance;
    // The extinction that is little to see.
    let little = select(-log(1.0 - frame.little) / step, FAR, frame.little >= 1.0);
    loop {
        if (m.i >= end || m.opacity > enough) {
            break;
        }
        // Up to where a run of labels begins.
        var stop = end;
        loop {
            if (m.i >= stop || m.opacity > enough) {
                break;
            }
            var until = stop;
#each
            if (SHADED_$) {
                if (m.i >= until_$) {
                    light_$(ray);
                }
                until = min(until, until_$);
            }
#end
            loop {
                if (m.i >= until || m.opacity > enough) {
                    break;
                }
                let length = select(1.0, frame.part, m.in_parts);
                let begin_mm = ray.enter_mm + m.i * step;
                let end_mm = ray.enter_mm + (m.i + length) * step;
                var ahead = 0.0;
                var behind = 0.0;
                var optical_depth = 0.0;
#each
                // A volume that begins or ends within the step counts for as much of it as it has.
                let from_$ = max(begin_mm, own_$.enter_mm);
                let to_$ = min(end_mm, own_$.leave_mm);
                let length_$ = max(to_$ - from_$, 0.0);
                let begins_$ = begin_mm <= own_$.enter_mm;
                var there_$ = vec4<f32>(0.0);
                var piece_$ = vec4<f32>(0.0);
                var now_$ = NO_LABEL;
                var changes_$ = false;
                // Where one label ends and the next begins.
                var turn_$ = from_$;
                // Whether the step is to be gone in parts if there is much to see.
                var varies_$ = true;
                if (LABELS_$) {
                    now_$ = label_at_$(voxel_of($u, at_$(to_$)));
                    changes_$ = now_$ != label_$ || begins_$;
                    // A label is the same all through, and a short step misses none.
                    varies_$ = changes_$ || step > 0.5 * parts[$].finest_mm;
                    // Up to the face that the ray leaves the first voxel by there is what was.
                    let face_mm = clamp(voxel_end_$(voxel_of($u, at_$(from_$))), from_$, from_$ + length_$);
                    turn_$ = select(face_mm, from_$, begins_$);
                    var look = vec4<f32>(0.0);
                    if (MANY_$) {
                        let in_list = stretches[parts[$].first_stretch + now_$];
                        look = vec4<f32>(in_list.color_from, in_list.opacity_to);
                    } else {
                        look = textureLoad(table_$, i32(now_$), 0);
                    }
                    there_$ = vec4<f32>(look.rgb, 1.0) * look.a;
                    if (LIT_$) {
                        // Its colour is not known yet where it begins.
                        there_$ = select(here_$, vec4<f32>(0.0, 0.0, 0.0, there_$.a), changes_$);
                    }
                    there_$ = select(vec4<f32>(0.0), there_$, length_$ > 0.0);
                    piece_$ = select(there_$ * length_$, here_$ * (turn_$ - from_$) + there_$ * (from_$ + length_$ - turn_$), changes_$);
                } else {
                    there_$ = select(vec4<f32>(0.0), optical_$(raw_at_$(at_$(to_$))), length_$ > 0.0);
                    piece_$ = (select(here_$, there_$, begins_$) + there_$) * (0.5 * length_$);
                }
                ahead += select(0.0, there_$.a, varies_$);
                behind += select(0.0, here_$.a, varies_$ && length_$ > 0.0 && !begins_$);
                optical_depth += piece_$.a;
#end
                // A step with more than little to see at either end is gone again, in parts.
                let again = !m.in_parts && frame.part < 1.0 && max(ahead, behind) > little;
                let transmittance = 1.0 - m.opacity;
                let weight = select(transmittance * opacity_of(optical_depth), 0.0, again);
                let share = select(0.0, weight / optical_depth, optical_depth > 0.0);
                let goal = select(m.i + length, m.i, again);
#each
                if (SHADED_$) {
                    let weight_$ = piece_$.a * share;
                    let first_$ = !(together_$.a > 0.0) && weight_$ > 0.0;
                    until_$ = select(until_$, floor(m.i) + frame.light_span, first_$);
                    together_$ += piece_$ * share;
                    moment_$ += weight_$ * 0.5 * (from_$ + to_$);
                    until_$ = select(until_$, goal, together_$.a > frame.light_weight);
                    until = min(until, until_$);
                } else {
                    color_$ += piece_$.rgb * share;
                }
                if (LABELS_$) {
                    if (LIT_$) {
                        // The loops end where a run begins that is seen.
                        let new_$ = changes_$ && !again && there_$.a > 0.0;
                        waiting_$ = select(waiting_$, there_$.a * (from_$ + length_$ - turn_$) * share, new_$);
                        run_mm_$ = select(run_mm_$, turn_$, new_$);
                        stop = select(stop, goal, new_$);
                        until = min(until, stop);
                    }
                    label_$ = select(now_$, label_$, again || !(length_$ > 0.0));
                }
                here_$ = select(there_$, here_$, again);
#end
                let is_before = m.opacity < 0.5;
                m.half_i = select(m.half_i, m.i, is_before);
                m.half_length = select(m.half_length, length, is_before);
                m.half_before = select(m.half_before, transmittance, is_before);
                m.half_after = select(m.half_after, transmittance - weight, is_before);
                m.opacity += weight;
                m.i = goal;
                m.in_parts = again || (m.in_parts && !(goal == floor(goal) && ahead <= little));
            }
        }
#each
        if (LABELS_$) {
            if (LIT_$) {
                light_run_$(ray);
            }
        }
#end
    }
}
#end_sets

fn is_set(mask: vec4<u32>, chunk: u32) -> bool {
    let words = mask & bits_from(vec4<i32>(i32(chunk)) - WORD_BEGINS) & ~bits_from(vec4<i32>(i32(chunk + 1u)) - WORD_BEGINS);
    return any(words != vec4<u32>(0u));
}

// The first chunk behind one that is not as it.
fn change_behind(mask: vec4<u32>, chunk: u32, on: bool) -> u32 {
    return lowest_bit(select(mask, ~mask, on) & bits_from(vec4<i32>(i32(chunk)) - WORD_BEGINS));
}

fn in_steps(ray: Ray, eye: u32, pixel: vec2<u32>) -> Pixel {
    let step = frame.step_mm;
    let count = ceil((ray.leave_mm - ray.enter_mm) / step);
    let enough = 1.0 - frame.least_transmittance;
    // A step belongs to the chunk that its middle lies in; masks have room for the rest of it.
    let chunk_first = (ray.chunks_begin_mm - ray.enter_mm) / step - 0.5;
    let chunk_step = ray.chunk_mm / step;
    m = March(0.0, false, 0.0, 0.0, 1.0, 1.0, 1.0);
#each
    here_$ = vec4<f32>(0.0);
    color_$ = vec3<f32>(0.0);
    together_$ = vec4<f32>(0.0);
    moment_$ = 0.0;
    until_$ = FAR;
    label_$ = NO_LABEL;
    waiting_$ = -1.0;
    run_mm_$ = 0.0;
    let mask_$ = textureLoad(masks, pixel >> vec2<u32>(frame.tile_power), eye * PARTS + $u, 0);
#end
    var chunk = 0u;
    loop {
        if (chunk >= CHUNKS || m.opacity > enough) {
            break;
        }
        // A run of chunks that show the same volumes.
        var next = CHUNKS;
        var shown = 0u;
#each
        let is_on_$ = is_set(mask_$, chunk);
        next = min(next, change_behind(mask_$, chunk, is_on_$));
        shown += u32(is_on_$);
#end
        let first = select(clamp(ceil(chunk_first + f32(chunk) * chunk_step), 0.0, count), 0.0, chunk == 0u);
        let end = select(clamp(ceil(chunk_first + f32(next) * chunk_step), 0.0, count), count, next >= CHUNKS);
        chunk = next;
        if (shown > 0u && first > m.i) {
            // What was left out holds nothing to be seen, its points on the lattice neither.
            m.i = first;
            m.in_parts = false;
#each
            here_$ = vec4<f32>(0.0);
            label_$ = NO_LABEL;
#end
        }
#each
        if (shown == 1u && is_on_$) {
            march_$(ray, end);
        }
#end
        if (shown > 1u) {
            march_all(ray, end);
        }
    }
    var out = Pixel(vec3<f32>(0.0), m.opacity, 0.0, m.opacity >= 0.5);
#each
    if (SHADED_$) {
        light_$(ray);
    }
    out.color += color_$;
#end
    if (out.has_depth) {
        // Within a piece light falls exponentially.
        let whole_fall = log(m.half_before / max(m.half_after, 1.0e-30));
        let part = clamp(log(2.0 * m.half_before) / whole_fall, 0.0, 1.0);
        out.depth_mm = ray.enter_mm + (m.half_i + part * m.half_length) * step;
    }
    return out;
}

// The pixel that an invocation casts the ray of.
struct Target {
    pixel: vec2<u32>,
    eye: u32,
    // Whether there is such a pixel.
    is_valid: bool,
}

// A workgroup casts 64 rays of listed tiles.
fn target_of(group: vec3<u32>, index: u32) -> Target {
    let ray = listed_ray(group, index, frame.tile_power);
    let number = work.tiles[min(ray.tile, work.tile_count - 1u)];
    let pixel = (tile_of(number) << vec2<u32>(frame.tile_power)) + ray.inside;
    return Target(pixel, tile_eye(number), ray.tile < work.tile_count && all(pixel < frame.render_size));
}

fn store(out: Pixel, ray: Ray, to: Target) {
    let depth = select(0.0, max(out.depth_mm + ray.eye_distance_mm, 1.0e-30), out.has_depth);
    textureStore(picture, to.pixel, to.eye, vec4<f32>(out.color, out.opacity));
    textureStore(depth_mm, to.pixel, to.eye, vec4<f32>(depth, 0.0, 0.0, 0.0));
}

@compute @workgroup_size(64)
fn several(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let to = target_of(group, index);
    if (!to.is_valid) {
        return;
    }
    let ray = ray_of(to.eye, to.pixel);
    var out = Pixel(vec3<f32>(0.0), 0.0, 0.0, false);
    if (ray.leave_mm > ray.enter_mm) {
        out = in_steps(ray, to.eye, to.pixel);
    }
    store(out, ray, to);
}
