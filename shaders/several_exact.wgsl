// Several volumes without steps and tables. Each volume alone is cut into pieces in which it is seen and smooth, as
// exact.wgsl cuts one; where pieces of several overlap they are cut again, and their sum is integrated by Boole's rule.

// A volume along the ray: the walk through its cells, and the next piece in which it is seen.
struct Source {
    // The walk.
    cell: vec3<i32>,
    at_mm: f32,
    // More would be a ray that gets nowhere.
    cells_left: i32,
    // The cell that it is in: how the value goes through it, and from where to where.
    value: vec4<f32>,
    turns: vec2<f32>,
    begin_mm: f32,
    length_mm: f32,
    gradient_x: vec4<f32>,
    gradient_y: vec4<f32>,
    gradient_z: vec4<f32>,
    // How far of that cell has been cut, and the stretch of the transfer function that follows.
    cut: f32,
    number: u32,
    // The piece: as parts of the way through the cell, in millimetres, and its stretch.
    from_u: f32,
    to_u: f32,
    from_mm: f32,
    to_mm: f32,
    piece_number: u32,
    // Whether there is no further piece.
    is_done: bool,
    // Of labels: the label of the run that the walk is in, its colour as lit, and its extinction.
    label: u32,
    color: vec3<f32>,
    extinction: f32,
}

#each
var<private> source_$: Source;
#end

// Halves where a stretch may lie; written out below, for a round of a loop is dear.
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

// The number of a part's stretch that a value lies in; there are at most 513.
fn stretch_of(k: u32, value: f32) -> u32 {
    var span = vec2<u32>(parts[k].first_stretch, parts[k].first_stretch + parts[k].stretches);
    span = halved(halved(halved(halved(halved(span, value), value), value), value), value);
    span = halved(halved(halved(halved(halved(span, value), value), value), value), value);
    return span.x;
}

#each
fn begin_$() {
    let last = vec3<i32>(parts[$].dims) - 1;
    var source: Source;
    source.is_done = !(own_$.leave_mm > own_$.enter_mm);
    source.at_mm = own_$.enter_mm;
    source.cells_left = last.x + last.y + last.z + 16;
    source.cut = 1.0;
    source.length_mm = 1.0;
    // It has had no piece yet; without a way there is none.
    source.from_mm = FAR;
    source.to_mm = select(-FAR, FAR, source.is_done);
    source.label = NO_LABEL;
    if (!source.is_done) {
        source.cell = clamp(vec3<i32>(floor(at_$(own_$.enter_mm))), vec3<i32>(-1), last);
        if (LABELS_$) {
            source.cell = voxel_of($u, at_$(own_$.enter_mm));
        }
    }
    source_$ = source;
}

// Millimetres from p along the ray to where it leaves the block of cells within `reach` of `cell`.
fn way_out_$(p: vec3<f32>, cell: vec3<i32>, reach: i32) -> f32 {
    let low = vec3<f32>(cell - reach) * CELL + CELL_MARGIN;
    let high = vec3<f32>(cell + reach + 1) * CELL - CELL_MARGIN;
    let away = (select(low, high, own_$.mm_per > vec3<f32>(0.0)) - p) * own_$.mm_per;
    return min(min(away.x, away.y), away.z);
}

// The gradient on the way from a to b through a cell in millimetres, up to a common factor, as exact.wgsl takes it.
fn take_gradient_$(cell: vec3<i32>, c: array<f32, 8>, a: vec3<f32>, b: vec3<f32>) {
    var at_corner = c;
    var x: array<f32, 8>;
    var y: array<f32, 8>;
    var z: array<f32, 8>;
    for (var i = 0u; i < 8u; i += 1u) {
        // Of the two neighbours along an axis, one is a corner too.
        let p = cell + corner(i);
        let out = corner(i) * 2 - 1;
        x[i] = (stored_$(p + vec3<i32>(out.x, 0, 0)) - at_corner[i ^ 1u]) * f32(out.x);
        y[i] = (stored_$(p + vec3<i32>(0, out.y, 0)) - at_corner[i ^ 2u]) * f32(out.y);
        z[i] = (stored_$(p + vec3<i32>(0, 0, out.z)) - at_corner[i ^ 4u]) * f32(out.z);
    }
    let per_index = mat3x4<f32>(across(x, a, b), across(y, a, b), across(z, a, b));
    let most = max(max(abs(per_index[0]), abs(per_index[1])), abs(per_index[2]));
    let strongest = max(max(most.x, most.y), max(most.z, most.w));
    source_$.gradient_x = vec4<f32>(0.0);
    source_$.gradient_y = vec4<f32>(0.0);
    source_$.gradient_z = vec4<f32>(0.0);
    if (strongest > 0.0) {
        // Scaled: the squares of differences of a float volume may be too small for float32.
        let scaled = per_index * (1.0 / strongest);
        source_$.gradient_x = scaled * parts[$].gradient_x;
        source_$.gradient_y = scaled * parts[$].gradient_y;
        source_$.gradient_z = scaled * parts[$].gradient_z;
    }
}

// Goes on to the next cell, and makes it ready to be cut if something of it may be seen.
fn enter_cell_$() {
    let dims = vec3<i32>(parts[$].dims);
    let cell = source_$.cell;
    let forth = own_$.mm_per > vec3<f32>(0.0);
    let plane = select(cell, cell + 1, forth);
    let is_there = (plane >= vec3<i32>(0)) & (plane < dims);
    let plane_mm = select(vec3<f32>(FAR), (vec3<f32>(plane) - own_$.anchor) * own_$.mm_per, is_there);
    let end_mm = min(min(min(plane_mm.x, plane_mm.y), plane_mm.z), own_$.leave_mm);
    let begin_mm = source_$.at_mm;
    source_$.cell = cell + select(vec3<i32>(0), select(vec3<i32>(-1), vec3<i32>(1), forth), plane_mm <= vec3<f32>(end_mm));
    source_$.at_mm = max(begin_mm, end_mm);
    source_$.cells_left -= 1;
    let entered = own_$.anchor + own_$.per_mm * begin_mm;
    let block = own_cell($u, vec3<f32>(max(cell, vec3<i32>(0))));
    let reach = reach_of_$(block);
    if (reach > 0u) {
        // To just before the end of the empty blocks: a walk from there meets the same next planes as one that went cell by
        // cell, so that what follows is the same to the bit.
        let leap_mm = begin_mm + way_out_$(entered, block, i32(reach) - 1);
        if (leap_mm > source_$.at_mm) {
            source_$.at_mm = leap_mm;
            source_$.cell = clamp(vec3<i32>(floor(own_$.anchor + own_$.per_mm * leap_mm)), vec3<i32>(-1), dims - 1);
        }
        return;
    }
    if (!(end_mm > begin_mm)) {
        return;
    }
    var corners: array<f32, 8>;
    for (var i = 0u; i < 8u; i += 1u) {
        corners[i] = stored_$(cell + corner(i));
    }
    let slope = parts[$].stored.z;
    let intercept = parts[$].stored.w;
    let lowest = min(min(min(corners[0], corners[1]), min(corners[2], corners[3])),
        min(min(corners[4], corners[5]), min(corners[6], corners[7]))) * slope + intercept;
    let highest = max(max(max(corners[0], corners[1]), max(corners[2], corners[3])),
        max(max(corners[4], corners[5]), max(corners[6], corners[7]))) * slope + intercept;
    let top = stretches[stretch_of($u, max(lowest, highest))];
    if (top.seen_before + u32(is_seen(top)) == stretches[stretch_of($u, min(lowest, highest))].seen_before) {
        return;
    }
    let a = clamp(entered - vec3<f32>(cell), vec3<f32>(0.0), vec3<f32>(1.0));
    let b = clamp(own_$.anchor + own_$.per_mm * end_mm - vec3<f32>(cell), vec3<f32>(0.0), vec3<f32>(1.0));
    source_$.value = across(corners, a, b) * slope + vec4<f32>(intercept, 0.0, 0.0, 0.0);
    source_$.turns = turns_of(source_$.value);
    if (LIT_$) {
        take_gradient_$(cell, corners, a, b);
    }
    source_$.begin_mm = begin_mm;
    source_$.length_mm = end_mm - begin_mm;
    source_$.number = stretch_of($u, source_$.value.x);
    source_$.cut = 0.0;
}

// Goes on to the next piece in which the volume is seen: between turns of the value and knots of the transfer function.
// What is not seen leaves no trace, so that skipping it changes nothing.
fn next_value_piece_$() {
    source_$.from_mm = FAR;
    source_$.to_mm = FAR;
    loop {
        if (source_$.cut >= 1.0) {
            if (source_$.at_mm >= own_$.leave_mm || source_$.cells_left <= 0) {
                source_$.is_done = true;
                break;
            }
            enter_cell_$();
            continue;
        }
        let value = source_$.value;
        let turns = source_$.turns;
        let u = source_$.cut;
        let turn = select(select(1.0, turns.y, u < turns.y), turns.x, u < turns.x);
        let goal = cubic_at(value, turn);
        let rises = goal > cubic_at(value, u);
        let number = source_$.number;
        let here = stretches[number];
        let knot = select(here.value_from, here.value_to, rises);
        var end = turn;
        if (select((goal < knot), (goal >= knot), rises)) {
            end = root_of(value, u, turn, knot);
            source_$.number = select(number - 1u, number + 1u, rises);
        }
        source_$.cut = end;
        if (is_seen(here) && end > u) {
            source_$.from_u = u;
            source_$.to_u = end;
            source_$.from_mm = source_$.begin_mm + source_$.length_mm * u;
            source_$.to_mm = source_$.begin_mm + source_$.length_mm * end;
            source_$.piece_number = number;
            // One so short that float32 has no room for it is nothing.
            if (source_$.to_mm > source_$.from_mm) {
                return;
            }
            source_$.from_mm = FAR;
            source_$.to_mm = FAR;
        }
    }
}

// The same of labels: voxel by voxel, as labels.wgsl goes.
fn next_label_piece_$() {
    source_$.from_mm = FAR;
    source_$.to_mm = FAR;
    let forth = own_$.mm_per > vec3<f32>(0.0);
    let side = select(vec3<f32>(-0.5), vec3<f32>(0.5), forth);
    loop {
        let begin_mm = source_$.at_mm;
        if (begin_mm >= own_$.leave_mm || source_$.cells_left <= 0) {
            source_$.is_done = true;
            break;
        }
        source_$.cells_left -= 1;
        let entered = at_$(begin_mm);
        let block = own_cell($u, entered);
        let reach = reach_of_$(block);
        let leap_mm = begin_mm + way_out_$(entered, block, i32(reach) - 1);
        if (reach > 0u && leap_mm > begin_mm) {
            // To just before the end of the empty cells: what follows is the same to the bit.
            source_$.at_mm = leap_mm;
            source_$.cell = voxel_of($u, at_$(leap_mm));
            source_$.label = NO_LABEL;
            continue;
        }
        let voxel = source_$.cell;
        let plane_mm = (vec3<f32>(voxel) + side - own_$.anchor) * own_$.mm_per;
        let end_mm = min(min(min(plane_mm.x, plane_mm.y), plane_mm.z), own_$.leave_mm);
        source_$.cell += select(vec3<i32>(0), select(vec3<i32>(-1), vec3<i32>(1), forth), plane_mm <= vec3<f32>(end_mm));
        source_$.at_mm = max(begin_mm, end_mm);
        if (!(source_$.at_mm > begin_mm)) {
            continue;
        }
        let label = label_at_$(voxel);
        let look = stretches[parts[$].first_stretch + label];
        if (!is_seen(look)) {
            source_$.label = NO_LABEL;
            continue;
        }
        if (label != source_$.label) {
            source_$.color = look.color_from;
            if (LIT_$) {
                source_$.color = lit($u, look.color_from, label_facing_$(entered, label, ray_direction_mm));
            }
        }
        source_$.label = label;
        source_$.extinction = look.opacity_to;
        source_$.from_mm = begin_mm;
        source_$.to_mm = source_$.at_mm;
        break;
    }
}

fn next_piece_$() {
    if (LABELS_$) {
        next_label_piece_$();
    } else {
        next_value_piece_$();
    }
}
#end

var<private> ray_direction_mm: vec3<f32>;

fn without_steps(ray: Ray) -> Pixel {
    var color = vec3<f32>(0.0);
    var optical_depth = 0.0;
    var half_mm = 0.0;
    // What a piece may be off by: what a ray's end may.
    let piece_error = max(frame.least_transmittance, 1.0e-5);
    let deepest = -log(max(frame.least_transmittance, 1.0e-12));
    var is_whole = true;
    ray_direction_mm = ray.direction_mm;
#each
    begin_$();
#end
    var at_mm = -FAR;
    loop {
#each
        if (source_$.to_mm <= at_mm) {
            next_piece_$();
        }
#end
        // The next overlap: from where some volume is seen to where one begins or ends.
        var begin_mm = FAR;
#each
        begin_mm = min(begin_mm, max(source_$.from_mm, at_mm));
#end
        if (begin_mm >= FAR || optical_depth >= deepest) {
            break;
        }
        var end_mm = FAR;
#each
        end_mm = min(end_mm, select(source_$.to_mm, source_$.from_mm, source_$.from_mm > begin_mm));
#end
        at_mm = end_mm;
#each
        // The part of its own piece that it has in the overlap. Its own ends it knows better than their millimetres tell.
        let begin_u_$ = select((begin_mm - source_$.begin_mm) / source_$.length_mm, source_$.from_u, begin_mm <= source_$.from_mm);
        let end_u_$ = select((end_mm - source_$.begin_mm) / source_$.length_mm, source_$.to_u, end_mm >= source_$.to_mm);
        let length_u_$ = max(end_u_$ - begin_u_$, 0.0);
        let is_here_$ = source_$.from_mm <= begin_mm && source_$.to_mm >= end_mm && source_$.to_mm < FAR;
        let stretch_$ = stretches[source_$.piece_number];
#end
        // Pieces of the overlap, each halved until Boole's rule agrees with Simpson's.
        let length_mm = end_mm - begin_mm;
        var begin = 0.0;
        var longest = select(1.0, LIT_PIECE, SHADED);
        while (begin < 1.0 && optical_depth < deepest && length_mm > 0.0) {
            let part = min(longest, 1.0 - begin);
            var x: array<f32, 5>;
            var c: array<vec3<f32>, 5>;
            // What the direction of a gradient that turns round between nodes can do to a colour.
            var turned = 0.0;
#each
            var before_it_$ = vec3<f32>(0.0);
#end
            for (var i = 0; i < 5; i += 1) {
                let place = begin + part * 0.25 * f32(i);
                var extinction = 0.0;
                var emitted = vec3<f32>(0.0);
#each
                if (LABELS_$) {
                    let e_$ = select(0.0, source_$.extinction, is_here_$);
                    extinction += e_$;
                    emitted += e_$ * source_$.color;
                } else {
                    let u_$ = begin_u_$ + length_u_$ * place;
                    let o_$ = optical_in(stretch_$, cubic_at(source_$.value, u_$));
                    let e_$ = select(0.0, extinction_of(o_$.a), is_here_$);
                    var shown_$ = o_$.rgb;
                    if (LIT_$) {
                        let g_$ = vec3<f32>(cubic_at(source_$.gradient_x, u_$), cubic_at(source_$.gradient_y, u_$),
                            cubic_at(source_$.gradient_z, u_$));
                        shown_$ = lit($u, shown_$, cosine_between(g_$, ray.direction_mm));
                        let turns_$ = is_here_$ && i > 0 && is_apart(before_it_$, g_$);
                        turned = select(turned, max(turned, parts[$].light.y + parts[$].light.z), turns_$);
                        before_it_$ = g_$;
                    }
                    extinction += e_$;
                    emitted += e_$ * shown_$;
                }
#end
                x[i] = extinction * part * length_mm;
                c[i] = vec3<f32>(0.0);
                if (extinction > 0.0) {
                    c[i] = emitted / extinction;
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
            // Where a gradient all but vanishes, light falls to ambient and rises again unseen by either rule.
            off = max(off, opacity * turned);
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
                half_mm = begin_mm + length_mm * (begin + part * (node + 0.25 * between));
            }
            optical_depth += d_4;
            begin = select(begin + part, 1.0, part >= 1.0 - begin);
            longest = 2.0 * part;
        }
        is_whole = is_whole && (begin >= 1.0 || optical_depth >= deepest || !(length_mm > 0.0));
    }
#each
    is_whole = is_whole && (source_$.is_done || optical_depth >= deepest);
#end
    return Pixel(color, select(UNFINISHED, opacity_of(optical_depth), is_whole), half_mm, optical_depth >= LN_2);
}

@compute @workgroup_size(64)
fn several_exact(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let to = target_of(group, index);
    if (!to.is_valid) {
        return;
    }
    let ray = ray_of(to.eye, to.pixel);
    var out = Pixel(vec3<f32>(0.0), 0.0, 0.0, false);
    if (ray.leave_mm > ray.enter_mm) {
        out = without_steps(ray);
    }
    store(out, ray, to);
}
