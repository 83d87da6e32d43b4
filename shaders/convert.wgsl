// The picture as the encoder takes it: both eyes side by side, YUV 4:2:0, BT.709, limited range, chroma sited between
// the two columns and rows it stands for. Scaled up bilinearly where the rays were fewer than the pixels.

// A layer an eye; larger than the picture, which lies in its upper left corner.
@group(1) @binding(0) var picture: texture_2d_array<f32>;
@group(1) @binding(1) var rays_sampler: sampler;
@group(1) @binding(2) var<storage, read_write> planes: array<u32>;
// Of each ray, where rays are fewer than pixels.
@group(1) @binding(3) var luma_of_rays: texture_2d_array<f32>;
@group(1) @binding(4) var chroma_of_rays: texture_2d_array<f32>;

override SCALED: bool = false;

// Where rays are looked at for a point of the picture, in pixels from its upper left corner. Held half a texel inside the
// picture: what lies beyond is another frame's.
fn among_rays(point: vec2<f32>) -> vec2<f32> {
    let size = vec2<f32>(frame.render_size);
    let scale = size / vec2<f32>(frame.output_size);
    return clamp(point * scale, vec2<f32>(0.5), size - 0.5) / vec2<f32>(textureDimensions(luma_of_rays));
}

// A block of 8 by 2 pixels: whole words of luma and of both chroma planes.
@compute @workgroup_size(8, 8)
fn convert(@builtin(global_invocation_id) id: vec3<u32>) {
    let width = frame.output_size.x * frame.eye_count;
    let left = id.x * 8u;
    let top = id.y * 2u;
    if (left >= width || top >= frame.output_size.y) {
        return;
    }
    let chroma_stride = frame.luma_stride / 2u;
    let luma_bytes = frame.luma_stride * frame.output_size.y;
    let chroma_bytes = chroma_stride * (frame.output_size.y / 2u);
    var words = array<u32, 4>(0u, 0u, 0u, 0u);
    var u_word = 0u;
    var v_word = 0u;
    for (var column = 0u; column < 4u; column += 1u) {
        var sum = vec3<f32>(0.0);
        var uv = vec2<f32>(0.0);
        for (var k = 0u; k < 4u; k += 1u) {
            let dx = column * 2u + (k & 1u);
            let dy = k >> 1u;
            // The padding at the right repeats the last pixel.
            let x = min(left + dx, width - 1u);
            let eye = select(0u, 1u, x >= frame.output_size.x);
            let pixel = vec2<u32>(x - eye * frame.output_size.x, top + dy);
            var y = 0.0;
            if (SCALED) {
                y = textureSampleLevel(luma_of_rays, rays_sampler, among_rays(vec2<f32>(pixel) + 0.5), eye, 0.0).r;
                if (k == 0u) {
                    uv = textureSampleLevel(chroma_of_rays, rays_sampler, among_rays(vec2<f32>(pixel) + 1.0), eye, 0.0).rg;
                }
            } else {
                let c = shown(textureLoad(picture, pixel, eye, 0));
                sum += c;
                y = luma(c);
            }
            words[dy * 2u + (dx >> 2u)] |= u32(y + 0.5) << ((dx & 3u) * 8u);
        }
        if (!SCALED) {
            uv = chroma(sum * 0.25);
        }
        u_word |= u32(uv.x + 0.5) << (column * 8u);
        v_word |= u32(uv.y + 0.5) << (column * 8u);
    }
    let at = (top * frame.luma_stride + left) / 4u;
    planes[at] = words[0];
    planes[at + 1u] = words[1];
    let below = at + frame.luma_stride / 4u;
    planes[below] = words[2];
    planes[below + 1u] = words[3];
    let chroma_at = (luma_bytes + id.y * chroma_stride + left / 2u) / 4u;
    planes[chroma_at] = u_word;
    planes[chroma_at + chroma_bytes / 4u] = v_word;
}
