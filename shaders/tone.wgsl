// Luma and chroma of each ray, where rays are fewer than pixels: what is made larger then is one number a pixel and two for
// four of them, instead of four a pixel.

// A layer an eye; larger than the picture, which lies in its upper left corner.
@group(1) @binding(0) var picture: texture_2d_array<f32>;
@group(1) @binding(1) var luma_of_rays: texture_storage_2d_array<r32float, write>;
@group(1) @binding(2) var chroma_of_rays: texture_storage_2d_array<rg32float, write>;

@compute @workgroup_size(8, 8)
fn tone(@builtin(global_invocation_id) id: vec3<u32>) {
    if (any(id.xy >= frame.render_size)) {
        return;
    }
    let c = shown(textureLoad(picture, id.xy, id.z, 0));
    textureStore(luma_of_rays, id.xy, id.z, vec4<f32>(luma(c), 0.0, 0.0, 0.0));
    textureStore(chroma_of_rays, id.xy, id.z, vec4<f32>(chroma(c), 0.0, 0.0));
}
