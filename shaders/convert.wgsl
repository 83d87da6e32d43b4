// The picture as the encoder takes it: both eyes side by side, YUV 4:2:0, BT.709, limited range, chroma sited between
// the two columns and rows it stands for. Scaled up bilinearly where the rays were fewer than the pixels.

// A layer an eye; larger than the picture, which lies in its upper left corner.
@group(1) @binding(0) var picture: texture_2d_array<f32>;
@group(1) @binding(1) var picture_sampler: sampler;
@group(1) @binding(2) var<storage, read_write> planes: array<u32>;

override SCALED: bool = false;

fn shown(eye: u32, pixel: vec2<u32>) -> vec3<f32> {
    var p: vec4<f32>;
    if (SCALED) {
        let scale = vec2<f32>(frame.render_size) / vec2<f32>(frame.output_size);
        // Held half a texel inside the picture: what lies beyond is another frame's.
        let most = vec2<f32>(frame.render_size) - 0.5;
        let q = clamp((vec2<f32>(pixel) + 0.5) * scale, vec2<f32>(0.5), most);
        p = textureSampleLevel(picture, picture_sampler, q / vec2<f32>(textureDimensions(picture)), eye, 0.0);
    } else {
        p = textureLoad(picture, pixel, eye, 0);
    }
    return p.rgb + (1.0 - p.a) * frame.background;
}

fn luma(c: vec3<f32>) -> u32 {
    return u32(16.5 + 219.0 * dot(c, vec3<f32>(0.2126, 0.7152, 0.0722)));
}

fn blue_difference(c: vec3<f32>) -> u32 {
    return u32(128.5 + 224.0 * dot(c, vec3<f32>(-0.2126, -0.7152, 0.9278)) / 1.8556);
}

fn red_difference(c: vec3<f32>) -> u32 {
    return u32(128.5 + 224.0 * dot(c, vec3<f32>(0.7874, -0.7152, -0.0722)) / 1.5748);
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
        for (var k = 0u; k < 4u; k += 1u) {
            let dx = column * 2u + (k & 1u);
            let dy = k >> 1u;
            // The padding at the right repeats the last pixel.
            let x = min(left + dx, width - 1u);
            let eye = select(0u, 1u, x >= frame.output_size.x);
            let c = clamp(shown(eye, vec2<u32>(x - eye * frame.output_size.x, top + dy)), vec3<f32>(0.0), vec3<f32>(1.0));
            sum += c;
            words[dy * 2u + (dx >> 2u)] |= luma(c) << ((dx & 3u) * 8u);
        }
        u_word |= blue_difference(sum * 0.25) << (column * 8u);
        v_word |= red_difference(sum * 0.25) << (column * 8u);
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
