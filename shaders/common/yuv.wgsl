// BT.709, limited range, of colours from 0 to 1: luma, and what blue and red differ from it by, in steps of 8 bits.

fn luma(c: vec3<f32>) -> f32 {
    return 16.0 + 219.0 * dot(c, vec3<f32>(0.2126, 0.7152, 0.0722));
}

fn chroma(c: vec3<f32>) -> vec2<f32> {
    let blue = dot(c, vec3<f32>(-0.2126, -0.7152, 0.9278)) / 1.8556;
    let red = dot(c, vec3<f32>(0.7874, -0.7152, -0.0722)) / 1.5748;
    return 128.0 + 224.0 * vec2<f32>(blue, red);
}

// What is shown of a pixel: it stands before the background.
fn shown(p: vec4<f32>) -> vec3<f32> {
    return clamp(p.rgb + (1.0 - p.a) * frame.background, vec3<f32>(0.0), vec3<f32>(1.0));
}
