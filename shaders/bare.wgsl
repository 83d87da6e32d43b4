// Filtered reads along the same rays, and nothing else but their sum: what the device gives at best, to hold the ray-caster
// against. Every tile that meets the volume is cast, and no ray ends before the volume does.

@compute @workgroup_size(64)
fn bare(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let own = own_pixel(group, index);
    if (!own.is_valid) {
        return;
    }
    let ray = ray_of(own.eye, own.pixel);
    var sum = 0.0;
    let way = ray.leave_mm - ray.enter_mm;
    if (way > 0.0) {
        let l = lattice(ray, ray.enter_mm + 0.5 * frame.step_mm, frame.step_mm);
        let count = ceil(way / frame.step_mm);
        var i = 0.0;
        loop {
            if (i >= count) {
                break;
            }
            sum += sample(l, i);
            i += 1.0;
        }
    }
    store(Pixel(vec3<f32>(sum), 1.0, 0.0, false), ray, own);
}
