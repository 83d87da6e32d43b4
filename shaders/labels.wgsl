// The picture of labels. A label is not interpolated: a voxel has one all through, so a ray goes from voxel to voxel, and
// what it gathers in each has a closed form. There is no step and no table; what is left is the rounding of float32, and
// what the end of a ray may cost.
//
// The voxels hold a label's place among the labels of the volume, and `stretches` has one for each of them: colour_from,
// opacity_from, and, as opacity_to, its extinction a millimetre.

// No label.
const NO_LABEL: u32 = 0xffffffffu;

fn label_at(voxel: vec3<i32>) -> u32 {
    return u32(stored(voxel));
}

// How much of a label is at a point: the trilinear interpolation of 1 where it is and 0 elsewhere.
fn share_at(p: vec3<f32>, label: u32) -> f32 {
    let q = clamp(p, vec3<f32>(0.0), frame.dims - 1.0);
    let low = floor(q);
    let f = q - low;
    let a = vec3<i32>(low);
    var share = 0.0;
    for (var i = 0u; i < 8u; i += 1u) {
        let c = corner(i);
        if (label_at(a + c) == label) {
            let weight = select(1.0 - f, f, c == vec3<i32>(1));
            share += weight.x * weight.y * weight.z;
        }
    }
    return share;
}

// The cosine between the ray and the gradient of a label's share.
fn label_facing(p: vec3<f32>, label: u32, direction_mm: vec3<f32>) -> f32 {
    if (COUNT) {
        counted.gradients += 1u;
    }
    let x = vec3<f32>(1.0, 0.0, 0.0);
    let y = vec3<f32>(0.0, 1.0, 0.0);
    let z = vec3<f32>(0.0, 0.0, 1.0);
    let g = vec3<f32>(
        share_at(p + x, label) - share_at(p - x, label),
        share_at(p + y, label) - share_at(p - y, label),
        share_at(p + z, label) - share_at(p - z, label),
    );
    // Where a label is all around, as at the border of its volume, what is left of the differences is rounding.
    return select(cosine_of(g, direction_mm), 0.0, all(abs(g) < vec3<f32>(SHARE_ROUNDING)));
}

fn voxel_of(p: vec3<f32>) -> vec3<i32> {
    return clamp(vec3<i32>(floor(p + 0.5)), vec3<i32>(0), vec3<i32>(frame.dims) - 1);
}

fn emission_absorption_of_labels(ray: Ray) -> Pixel {
    var color = vec3<f32>(0.0);
    var optical_depth = 0.0;
    var half_mm = 0.0;
    let deepest = -log(max(frame.least_transmittance, 1.0e-12));
    let forth = ray.mm_per > vec3<f32>(0.0);
    let side = select(vec3<f32>(-0.5), vec3<f32>(0.5), forth);
    var voxel = voxel_of(at(ray, ray.enter_mm));
    var at_mm = ray.enter_mm;
    // Neighbouring voxels of one label are one run, lit as where the ray enters it.
    var run_label = NO_LABEL;
    var run_color = vec3<f32>(0.0);
    // More would be a ray that gets nowhere.
    var voxels_left = i32(frame.dims.x + frame.dims.y + frame.dims.z) + 16;
    while (at_mm < ray.leave_mm && optical_depth < deepest && voxels_left > 0) {
        voxels_left -= 1;
        if (SKIP) {
            let p = at(ray, at_mm);
            let cell = cell_of(p, CELL);
            let reach = textureLoad(distance_to_seen, cell, 0).r * frame.skip_empty;
            let leap_mm = at_mm + way_out(p, cell, CELL, i32(reach) - 1, ray.mm_per);
            if (reach > 0u && leap_mm > at_mm) {
                // To just before the end of the empty cells: what follows is the same to the bit.
                at_mm = leap_mm;
                voxel = voxel_of(at(ray, leap_mm));
                run_label = NO_LABEL;
                continue;
            }
        }
        let plane_mm = (vec3<f32>(voxel) + side - ray.anchor) * ray.mm_per;
        let end_mm = min(min(min(plane_mm.x, plane_mm.y), plane_mm.z), ray.leave_mm);
        let here = voxel;
        voxel += select(vec3<i32>(0), select(vec3<i32>(-1), vec3<i32>(1), forth), plane_mm <= vec3<f32>(end_mm));
        let begin_mm = at_mm;
        at_mm = max(begin_mm, end_mm);
        let length_mm = at_mm - begin_mm;
        if (!(length_mm > 0.0)) {
            continue;
        }
        let label = label_at(here);
        if (COUNT) {
            counted.samples += 1u;
        }
        if (!is_seen(stretches[label])) {
            run_label = NO_LABEL;
            continue;
        }
        if (label != run_label) {
            run_label = label;
            run_color = stretches[label].color_from;
            if (LIT) {
                run_color = lit(run_color, label_facing(at(ray, begin_mm), label, ray.direction_mm));
            }
        }
        let extinction_per_mm = stretches[label].opacity_to;
        let depth = extinction_per_mm * length_mm;
        let missing = LN_2 - optical_depth;
        if (missing > 0.0 && missing <= depth) {
            half_mm = begin_mm + missing / extinction_per_mm;
        }
        color += exp(-optical_depth) * opacity_of(depth) * run_color;
        if (COUNT) {
            counted.contributed += u32(depth > 0.0);
        }
        optical_depth += depth;
    }
    let is_whole = voxels_left > 0 || at_mm >= ray.leave_mm || optical_depth >= deepest;
    return Pixel(color, select(UNFINISHED, opacity_of(optical_depth), is_whole), half_mm, optical_depth >= LN_2);
}

@compute @workgroup_size(64)
fn labels(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let own = own_pixel(group, index);
    if (!own.is_valid) {
        return;
    }
    let ray = ray_of(own.eye, own.pixel);
    var out = Pixel(vec3<f32>(0.0), 0.0, 0.0, false);
    if (ray.leave_mm > ray.enter_mm) {
        out = emission_absorption_of_labels(ray);
    }
    store(out, ray, own);
}
