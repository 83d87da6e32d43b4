// The field: values and gradients of the volume, and the cells that hold nothing to be seen.

// Interpolate in float32 from eight fetched voxels instead of trusting the filtering unit.
override EXACT_FILTER: bool = false;

// Count what a ray looks at and store that instead of the picture: to measure with, never to show.
override COUNT: bool = false;

struct Counted {
    // Values that were looked at along the ray; with `exact`, voxel cells.
    samples: u32,
    // Those of them that changed the pixel.
    contributed: u32,
    // Gradients: six values each, or a cell's worth.
    gradients: u32,
}

var<private> counted: Counted;

@group(1) @binding(0) var voxels: texture_3d<f32>;
@group(1) @binding(1) var voxel_sampler: sampler;

// Voxels along a side of a cell that knows whether something is seen, and of one that knows its maximum: a ray looks these
// up one by one, so that they are larger.
const CELL: f32 = 4.0;
const MAXIMUM_CELL: f32 = 8.0;
// How near the border of a cell, in voxels, a sample is held to be outside: more than float32 can err by.
const CELL_MARGIN: f32 = 1.0e-3;

fn fetched(p: vec3<i32>) -> f32 {
    return textureLoad(voxels, p, 0).r;
}

// The stored value at a point, before slope and intercept.
fn raw_at(p: vec3<f32>) -> f32 {
    if (!EXACT_FILTER) {
        return textureSampleLevel(voxels, voxel_sampler, (p + 0.5) / frame.dims, 0.0).r;
    }
    let q = clamp(p, vec3<f32>(0.0), frame.dims - 1.0);
    let low = floor(q);
    let f = q - low;
    let a = vec3<i32>(low);
    let b = min(a + 1, vec3<i32>(frame.dims) - 1);
    let x00 = mix(fetched(vec3<i32>(a.x, a.y, a.z)), fetched(vec3<i32>(b.x, a.y, a.z)), f.x);
    let x10 = mix(fetched(vec3<i32>(a.x, b.y, a.z)), fetched(vec3<i32>(b.x, b.y, a.z)), f.x);
    let x01 = mix(fetched(vec3<i32>(a.x, a.y, b.z)), fetched(vec3<i32>(b.x, a.y, b.z)), f.x);
    let x11 = mix(fetched(vec3<i32>(a.x, b.y, b.z)), fetched(vec3<i32>(b.x, b.y, b.z)), f.x);
    return mix(mix(x00, x10, f.y), mix(x01, x11, f.y), f.z);
}

fn value_at(p: vec3<f32>) -> f32 {
    if (COUNT) {
        counted.samples += 1u;
    }
    return raw_at(p) * frame.value_scale + frame.value_offset;
}

// Cosine between the gradient and the ray, both in millimetres; 0 where there is no gradient.
fn facing(p: vec3<f32>, direction_mm: vec3<f32>) -> f32 {
    if (COUNT) {
        counted.gradients += 1u;
    }
    let g = vec3<f32>(
        raw_at(p + vec3<f32>(1.0, 0.0, 0.0)) - raw_at(p - vec3<f32>(1.0, 0.0, 0.0)),
        raw_at(p + vec3<f32>(0.0, 1.0, 0.0)) - raw_at(p - vec3<f32>(0.0, 1.0, 0.0)),
        raw_at(p + vec3<f32>(0.0, 0.0, 1.0)) - raw_at(p - vec3<f32>(0.0, 0.0, 1.0)),
    );
    return cosine_of(g, direction_mm);
}

// The same, of a gradient by index, up to a common factor.
fn cosine_of(g: vec3<f32>, direction_mm: vec3<f32>) -> f32 {
    let strongest = max(max(abs(g.x), abs(g.y)), abs(g.z));
    if (!(strongest > 0.0)) {
        return 0.0;
    }
    // Scaled first: the squares of differences of a float volume may be too small for float32.
    let n = (g / strongest) * mat3x3<f32>(frame.gradient_x, frame.gradient_y, frame.gradient_z);
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

// The highlight.
fn mirrored(cosine: f32) -> vec3<f32> {
    if (cosine > 0.0) {
        return vec3<f32>(frame.light.z * pow(cosine, frame.light.w));
    }
    return vec3<f32>(0.0);
}

fn lit(color: vec3<f32>, cosine: f32) -> vec3<f32> {
    return color * (frame.light.x + frame.light.y * cosine) + mirrored(cosine);
}

// The cell of `size` voxels a side that a point lies in.
fn cell_of(p: vec3<f32>, size: f32) -> vec3<i32> {
    let last = vec3<i32>((frame.dims - 1.0) / size);
    return clamp(vec3<i32>(floor(p / size)), vec3<i32>(0), last);
}

// Millimetres from p along the ray to where it leaves the block of cells within `reach` of `cell`.
fn way_out(p: vec3<f32>, cell: vec3<i32>, size: f32, reach: i32, mm_per: vec3<f32>) -> f32 {
    let low = vec3<f32>(cell - reach) * size + CELL_MARGIN;
    let high = vec3<f32>(cell + reach + 1) * size - CELL_MARGIN;
    // The reciprocal's sign: a direction of 0 has one, held apart from 0 as the reciprocal is.
    let ahead = select(low, high, mm_per > vec3<f32>(0.0));
    let away = (ahead - p) * mm_per;
    return min(min(away.x, away.y), away.z);
}
