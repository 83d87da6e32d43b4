// The picture without steps and tables. Along a ray the field of a voxel cell is a cubic, so cell by cell: surfaces and
// knots of the transfer function are roots of it, maxima lie at its turns, the mean is Simpson's rule, and emission and
// absorption is integrated between knots by Boole's rule on pieces that are halved until they are true. What is left is
// the rounding of float32. For stills: a frame takes what it takes.

// In the order of values.
@group(2) @binding(4) var<storage, read> stretches: array<Stretch>;

// The opacity of a pixel whose ray was not followed to its end. Mesa's software driver leaves the loops of a shader after
// 65 535 rounds in all.
const UNFINISHED: f32 = -1.0;

// The stored number itself. Integers come as parts of their range, rounded to float32: they are made whole again.
fn stored(p: vec3<i32>) -> f32 {
    let raw = fetched(clamp(p, vec3<i32>(0), vec3<i32>(frame.dims) - 1));
    return select(raw, round(raw * frame.stored.x) + frame.stored.y, frame.stored.x > 0.0);
}

// Halves where a stretch may lie; written out below, for a round of a loop is dear (see UNFINISHED).
fn halved(span: vec2<u32>, value: f32) -> vec2<u32> {
    let middle = (span.x + span.y) / 2u;
    if (span.y - span.x > 1u) {
        if (stretches[middle].value_from <= value) {
            return vec2<u32>(middle, span.y);
        }
        return vec2<u32>(span.x, middle);
    }
    return span;
}

// The number of the stretch that a value lies in; there are at most 513.
fn stretch_of(value: f32) -> u32 {
    var span = vec2<u32>(0u, arrayLength(&stretches));
    span = halved(halved(halved(halved(halved(span, value), value), value), value), value);
    span = halved(halved(halved(halved(halved(span, value), value), value), value), value);
    return span.x;
}

// One ray's way through one cell.
struct Passage {
    // Between the centres cell and cell + 1; -1 and the last centre make the half cells at the border.
    cell: vec3<i32>,
    // Where the cell is entered and left, each coordinate 0 to 1.
    begin: vec3<f32>,
    end: vec3<f32>,
    begin_mm: f32,
    length_mm: f32,
}

struct Walk {
    cell: vec3<i32>,
    at_mm: f32,
    // More would be a ray that gets nowhere.
    cells_left: i32,
}

fn walk_of(ray: Ray) -> Walk {
    let last = vec3<i32>(frame.dims) - 1;
    let cell = clamp(vec3<i32>(floor(at(ray, ray.enter_mm))), vec3<i32>(-1), last);
    return Walk(cell, ray.enter_mm, last.x + last.y + last.z + 16);
}

fn is_walking(walk: Walk, ray: Ray) -> bool {
    return walk.at_mm < ray.leave_mm && walk.cells_left > 0;
}

// The way through the cell in which the walk is; the walk goes on to the next one. A passage depends on its cell alone,
// not on how the walk came there.
fn passed(walk: ptr<function, Walk>, ray: Ray) -> Passage {
    let cell = (*walk).cell;
    let forth = ray.mm_per > vec3<f32>(0.0);
    let plane = select(cell, cell + 1, forth);
    let is_there = (plane >= vec3<i32>(0)) & (plane < vec3<i32>(frame.dims));
    let plane_mm = select(vec3<f32>(FAR), (vec3<f32>(plane) - ray.anchor) * ray.mm_per, is_there);
    let end_mm = min(min(min(plane_mm.x, plane_mm.y), plane_mm.z), ray.leave_mm);
    let begin_mm = (*walk).at_mm;
    (*walk).cell = cell + select(vec3<i32>(0), select(vec3<i32>(-1), vec3<i32>(1), forth), plane_mm <= vec3<f32>(end_mm));
    (*walk).at_mm = max(begin_mm, end_mm);
    (*walk).cells_left -= 1;
    let corner = vec3<f32>(cell);
    var passage: Passage;
    passage.cell = cell;
    passage.begin = clamp(at(ray, begin_mm) - corner, vec3<f32>(0.0), vec3<f32>(1.0));
    passage.end = clamp(at(ray, end_mm) - corner, vec3<f32>(0.0), vec3<f32>(1.0));
    passage.begin_mm = begin_mm;
    passage.length_mm = max(end_mm - begin_mm, 0.0);
    return passage;
}

// Goes on to just before the end of the empty blocks around the cell that was passed. A walk from there meets the same
// next planes as one that went cell by cell, so that what follows is the same to the bit.
fn leap(walk: ptr<function, Walk>, ray: Ray, passage: Passage, size: f32, reach: u32) {
    let p = at(ray, passage.begin_mm);
    let leap_mm = passage.begin_mm + way_out(p, block_of(passage.cell, size), size, i32(reach) - 1, ray.mm_per);
    if (leap_mm > (*walk).at_mm) {
        (*walk).at_mm = leap_mm;
        (*walk).cell = clamp(vec3<i32>(floor(at(ray, leap_mm))), vec3<i32>(-1), vec3<i32>(frame.dims) - 1);
    }
}

// The block of `size` voxels a side that knows what a cell holds.
fn block_of(cell: vec3<i32>, size: f32) -> vec3<i32> {
    return cell_of(vec3<f32>(max(cell, vec3<i32>(0))), size);
}

// What is stored at the corners of a cell, x fastest.
fn corners_of(cell: vec3<i32>) -> array<f32, 8> {
    if (COUNT) {
        counted.samples += 1u;
    }
    var c: array<f32, 8>;
    for (var i = 0u; i < 8u; i += 1u) {
        c[i] = stored(cell + corner(i));
    }
    return c;
}

// The lowest and the highest value of eight corners; all between them lies between these.
fn range_of(c: array<f32, 8>) -> vec2<f32> {
    let low = min(min(min(c[0], c[1]), min(c[2], c[3])), min(min(c[4], c[5]), min(c[6], c[7])));
    let high = max(max(max(c[0], c[1]), max(c[2], c[3])), max(max(c[4], c[5]), max(c[6], c[7])));
    let a = low * frame.stored.z + frame.stored.w;
    let b = high * frame.stored.z + frame.stored.w;
    return vec2<f32>(min(a, b), max(a, b));
}

// The value on the way from a to b through a cell, a cubic.
fn value_across(c: array<f32, 8>, a: vec3<f32>, b: vec3<f32>) -> vec4<f32> {
    return across(c, a, b) * frame.stored.z + vec4<f32>(frame.stored.w, 0.0, 0.0, 0.0);
}

// The gradient on the way from a to b through a cell, in millimetres, up to a common factor: three cubics. Inside a cell
// the central difference is the trilinear interpolation of those at its corners.
struct Gradient {
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
}

fn gradient_across(cell: vec3<i32>, c: array<f32, 8>, a: vec3<f32>, b: vec3<f32>) -> Gradient {
    if (COUNT) {
        counted.gradients += 1u;
    }
    var at_corner = c;
    var x: array<f32, 8>;
    var y: array<f32, 8>;
    var z: array<f32, 8>;
    for (var i = 0u; i < 8u; i += 1u) {
        // Of the two neighbours along an axis, one is a corner too.
        let p = cell + corner(i);
        let out = corner(i) * 2 - 1;
        x[i] = (stored(p + vec3<i32>(out.x, 0, 0)) - at_corner[i ^ 1u]) * f32(out.x);
        y[i] = (stored(p + vec3<i32>(0, out.y, 0)) - at_corner[i ^ 2u]) * f32(out.y);
        z[i] = (stored(p + vec3<i32>(0, 0, out.z)) - at_corner[i ^ 4u]) * f32(out.z);
    }
    let per_index = mat3x4<f32>(across(x, a, b), across(y, a, b), across(z, a, b));
    let most = max(max(abs(per_index[0]), abs(per_index[1])), abs(per_index[2]));
    let strongest = max(max(most.x, most.y), max(most.z, most.w));
    if (!(strongest > 0.0)) {
        return Gradient(vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0));
    }
    // Scaled: the squares of differences of a float volume may be too small for float32.
    let scaled = per_index * (1.0 / strongest);
    return Gradient(scaled * frame.gradient_x, scaled * frame.gradient_y, scaled * frame.gradient_z);
}

fn gradient_at(g: Gradient, u: f32) -> vec3<f32> {
    return vec3<f32>(cubic_at(g.x, u), cubic_at(g.y, u), cubic_at(g.z, u));
}

fn emission_absorption_exact(ray: Ray) -> Pixel {
    var color = vec3<f32>(0.0);
    var optical_depth = 0.0;
    var half_mm = 0.0;
    // What a piece may be off by: what a ray's end may.
    let piece_error = max(frame.least_transmittance, 1.0e-5);
    let deepest = -log(max(frame.least_transmittance, 1.0e-12));
    // What the gradient's direction can do to a colour.
    let light_turned = frame.light.y + frame.light.z;
    var is_whole = true;
    var walk = walk_of(ray);
    while (is_walking(walk, ray) && optical_depth < deepest) {
        let passage = passed(&walk, ray);
        if (SKIP) {
            let reach = textureLoad(distance_to_seen, block_of(passage.cell, CELL), 0).r * frame.skip_empty;
            if (reach > 0u) {
                leap(&walk, ray, passage, CELL, reach);
                continue;
            }
        }
        if (!(passage.length_mm > 0.0)) {
            continue;
        }
        let corners = corners_of(passage.cell);
        let range = range_of(corners);
        let top = stretches[stretch_of(range.y)];
        if (top.seen_before + u32(is_seen(top)) == stretches[stretch_of(range.x)].seen_before) {
            continue;
        }
        let value = value_across(corners, passage.begin, passage.end);
        let turns = turns_of(value);
        var gradient: Gradient;
        if (LIT) {
            gradient = gradient_across(passage.cell, corners, passage.begin, passage.end);
        }
        let depth_before = optical_depth;
        // From the begin to the end of the cell, cut where the value turns and where it passes a knot.
        var u = 0.0;
        var begin = 0.0;
        var end = 0.0;
        var number = stretch_of(value.x);
        while (u < 1.0 && optical_depth < deepest) {
            let turn = select(select(1.0, turns.y, u < turns.y), turns.x, u < turns.x);
            let goal = cubic_at(value, turn);
            let rises = goal > cubic_at(value, u);
            let here = stretches[number];
            end = turn;
            let knot = select(here.value_from, here.value_to, rises);
            if (select((goal < knot), (goal >= knot), rises)) {
                end = root_of(value, u, turn, knot);
                number = select(number - 1u, number + 1u, rises);
            }
            let stretch_begin = u;
            u = end;
            if (!is_seen(here)) {
                continue;
            }
            // Pieces of the stretch, each halved until Boole's rule agrees with Simpson's.
            begin = stretch_begin;
            var longest = select(1.0, LIT_PIECE, LIT);
            while (begin < end && optical_depth < deepest) {
                let part = min(longest, end - begin);
                var x: array<f32, 5>;
                var c: array<vec3<f32>, 5>;
                var before_it = vec3<f32>(0.0);
                var turns_between = false;
                for (var i = 0; i < 5; i += 1) {
                    let place = begin + part * 0.25 * f32(i);
                    let o = optical_in(here, cubic_at(value, place));
                    x[i] = extinction_of(o.a) * part * passage.length_mm;
                    c[i] = o.rgb;
                    if (LIT) {
                        let g = gradient_at(gradient, place);
                        c[i] = lit(o.rgb, cosine_between(g, ray.direction_mm));
                        turns_between = turns_between || (i > 0 && is_apart(before_it, g));
                        before_it = g;
                    }
                }
                // The optical depth at each node is the integral of the quartic through the five.
                let d_1 = max((251.0 * x[0] + 646.0 * x[1] - 264.0 * x[2] + 106.0 * x[3] - 19.0 * x[4]) / 2880.0, 0.0);
                let d_2 = max((29.0 * x[0] + 124.0 * x[1] + 24.0 * x[2] + 4.0 * x[3] - x[4]) / 360.0, 0.0);
                let d_3 = max((27.0 * x[0] + 102.0 * x[1] + 72.0 * x[2] + 42.0 * x[3] - 3.0 * x[4]) / 320.0, 0.0);
                let d_4 = boole(x[0], x[1], x[2], x[3], x[4]);
                let s_1 = x[1] * exp(-d_1);
                let s_2 = x[2] * exp(-d_2);
                let s_3 = x[3] * exp(-d_3);
                let s_4 = x[4] * exp(-d_4);
                // How much of each node's colour is seen. Their sum is known: 1 - exp(-d).
                let opacity = opacity_of(d_4);
                let fine = boole(x[0], s_1, s_2, s_3, s_4);
                let coarse = (x[0] + 4.0 * s_2 + s_4) / 6.0;
                var seen = vec3<f32>(0.0);
                var seen_coarsely = vec3<f32>(0.0);
                if (fine > 0.0) {
                    seen = (7.0 * (x[0] * c[0] + s_4 * c[4]) + 32.0 * (s_1 * c[1] + s_3 * c[3]) + 12.0 * s_2 * c[2])
                        * (opacity / (90.0 * fine));
                }
                if (coarse > 0.0) {
                    seen_coarsely = (x[0] * c[0] + 4.0 * s_2 * c[2] + s_4 * c[4]) * (opacity / (6.0 * coarse));
                }
                let off_color = abs(seen - seen_coarsely);
                let off_depth = abs(d_4 - (x[0] + 4.0 * x[2] + x[4]) / 6.0) * (1.0 - opacity);
                var off = max(max(max(off_color.x, off_color.y), off_color.z), max(off_depth, abs(fine - opacity)));
                if (turns_between) {
                    // Where the gradient all but vanishes it turns round within less than the nodes are apart, and light
                    // falls to ambient and rises again unseen by either rule.
                    off = max(off, opacity * light_turned);
                }
                let light = exp(-optical_depth);
                if (off * light > piece_error && part > LEAST_PIECE) {
                    longest = 0.5 * part;
                    continue;
                }
                color += light * seen;
                let missing = LN_2 - optical_depth;
                if (missing > 0.0 && missing <= d_4) {
                    // Straight between the nodes.
                    var before = 0.0;
                    var after = d_1;
                    var node = 0.0;
                    if (missing > d_1) { before = d_1; after = d_2; node = 0.25; }
                    if (missing > d_2) { before = d_2; after = d_3; node = 0.5; }
                    if (missing > d_3) { before = d_3; after = d_4; node = 0.75; }
                    let between = clamp((missing - before) / max(after - before, 1.0e-30), 0.0, 1.0);
                    half_mm = passage.begin_mm + passage.length_mm * (begin + part * (node + 0.25 * between));
                }
                optical_depth += d_4;
                begin = select(begin + part, end, part >= end - begin);
                longest = 2.0 * part;
            }
            is_whole = is_whole && (begin >= end || optical_depth >= deepest);
        }
        if (COUNT) {
            counted.contributed += u32(optical_depth > depth_before);
        }
        is_whole = is_whole && (u >= 1.0 || optical_depth >= deepest);
    }
    is_whole = is_whole && !(is_walking(walk, ray) && optical_depth < deepest);
    return Pixel(color, select(UNFINISHED, opacity_of(optical_depth), is_whole), half_mm, optical_depth >= LN_2);
}

fn first_crossing_exact(ray: Ray) -> Pixel {
    var out = Pixel(vec3<f32>(0.0), 0.0, 0.0, false);
    var found: Passage;
    var value = vec4<f32>(0.0);
    var low = 0.0;
    var high = 0.0;
    var walk = walk_of(ray);
    while (is_walking(walk, ray)) {
        let passage = passed(&walk, ray);
        if (SKIP) {
            let reach = textureLoad(distance_to_seen, block_of(passage.cell, CELL), 0).r * frame.skip_empty;
            if (reach > 0u) {
                leap(&walk, ray, passage, CELL, reach);
                continue;
            }
        }
        let corners = corners_of(passage.cell);
        if (!(passage.length_mm > 0.0) || range_of(corners).y < frame.threshold) {
            continue;
        }
        value = value_across(corners, passage.begin, passage.end);
        let turns = turns_of(value);
        // Between its turns the value rises or falls: it first reaches the threshold in the first part that ends above.
        low = 0.0;
        high = 0.0;
        var is_above = value.x >= frame.threshold;
        if (!is_above) {
            high = turns.x;
            is_above = cubic_at(value, high) >= frame.threshold;
        }
        if (!is_above) {
            low = high;
            high = turns.y;
            is_above = cubic_at(value, high) >= frame.threshold;
        }
        if (!is_above) {
            low = high;
            high = 1.0;
            is_above = cubic_at(value, high) >= frame.threshold;
        }
        if (is_above) {
            found = passage;
            out.has_depth = true;
            break;
        }
    }
    if (!out.has_depth) {
        return out;
    }
    if (COUNT) {
        counted.contributed += 1u;
    }
    var u = high;
    if (high > low) {
        u = root_of(value, low, high, frame.threshold);
    }
    out.depth_mm = found.begin_mm + found.length_mm * u;
    let p = found.begin + (found.end - found.begin) * u;
    let gradient = gradient_at(gradient_across(found.cell, corners_of(found.cell), p, p), 0.0);
    let cosine = cosine_between(gradient, ray.direction_mm);
    out.opacity = frame.surface_opacity;
    out.color = lit(frame.surface_color, cosine) * out.opacity;
    return out;
}

fn x_ray_exact(ray: Ray) -> Pixel {
    // Two sums: a float32 sum of tens of thousands of terms alone would lose the digits of each.
    var sum = 0.0;
    var part = 0.0;
    var way = 0.0;
    var way_part = 0.0;
    var walk = walk_of(ray);
    while (is_walking(walk, ray)) {
        let passage = passed(&walk, ray);
        let c = value_across(corners_of(passage.cell), passage.begin, passage.end);
        if (COUNT) {
            counted.contributed += 1u;
        }
        part += (c.x + c.y / 2.0 + c.z / 3.0 + c.w / 4.0) * passage.length_mm;
        way_part += passage.length_mm;
        if ((walk.cells_left & 63) == 0) {
            sum += part;
            way += way_part;
            part = 0.0;
            way_part = 0.0;
        }
    }
    let mean = (sum + part) / (way + way_part);
    let grey = clamp((mean - frame.window_low) * frame.window_per_value, 0.0, 1.0);
    return Pixel(vec3<f32>(grey), grey, 0.5 * (ray.enter_mm + ray.leave_mm), true);
}

fn maximum_exact(ray: Ray) -> Pixel {
    var best = -FAR;
    var best_mm = ray.enter_mm;
    var walk = walk_of(ray);
    while (is_walking(walk, ray)) {
        let passage = passed(&walk, ray);
        if (SKIP) {
            if (frame.skip_empty != 0u && textureLoad(cell_maximum, block_of(passage.cell, MAXIMUM_CELL), 0).r <= best) {
                leap(&walk, ray, passage, MAXIMUM_CELL, 1u);
                continue;
            }
        }
        let corners = corners_of(passage.cell);
        if (!(passage.length_mm > 0.0) || range_of(corners).y <= best) {
            continue;
        }
        let value = value_across(corners, passage.begin, passage.end);
        let turns = turns_of(value);
        let best_before = best;
        for (var i = 0; i < 4; i += 1) {
            let u = select(select(select(0.0, turns.x, i == 1), turns.y, i == 2), 1.0, i == 3);
            let height = cubic_at(value, u);
            if (height > best) {
                best = height;
                best_mm = passage.begin_mm + passage.length_mm * u;
            }
        }
        if (COUNT) {
            counted.contributed += u32(best > best_before);
        }
    }
    let o = optical_in(stretches[stretch_of(best)], best);
    return Pixel(o.rgb * o.a, o.a, best_mm, true);
}

@compute @workgroup_size(64)
fn exact(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let own = own_pixel(group, index);
    if (!own.is_valid) {
        return;
    }
    let ray = ray_of(own.eye, own.pixel);
    var out = Pixel(vec3<f32>(0.0), 0.0, 0.0, false);
    if (ray.leave_mm > ray.enter_mm) {
        if (MODE == EMISSION_ABSORPTION) {
            out = emission_absorption_exact(ray);
        } else if (MODE == THRESHOLD) {
            out = first_crossing_exact(ray);
        } else if (MODE == X_RAY) {
            out = x_ray_exact(ray);
        } else if (MODE == MAXIMUM) {
            out = maximum_exact(ray);
        } else {
            out = surface_over(first_crossing_exact(ray), x_ray_exact(ray));
        }
    }
    store(out, ray, own);
}
