// What every ray of a frame shares. The Rust mirrors are `GpuEye` and `GpuFrame`; a test compares the layouts.
//
// Points and directions are in index space (voxels, the first voxel's centre at 0) unless a name says otherwise.

// One eye. The ray of the pixel at (x, y), each from -1/2 to 1/2 over the picture, passes through
//   anchor + anchor_depth * (x * ray_dx + y * ray_dy)  in direction  ray + x * ray_dx + y * ray_dy.
// The anchor lies near the volume, not at the eye: float32 keeps its digits where the samples are.
struct Eye {
    anchor: vec3<f32>,
    anchor_depth: f32,
    ray: vec3<f32>,
    // Nearest and farthest depth of the volume, in the anchor's measure: 1 is as far as `ray` is long.
    near: f32,
    ray_dx: vec3<f32>,
    far: f32,
    ray_dy: vec3<f32>,
    // The same direction in millimetres.
    ray_mm: vec3<f32>,
    ray_dx_mm: vec3<f32>,
    ray_dy_mm: vec3<f32>,
}

struct Frame {
    eyes: array<Eye, 2>,
    // Pixels of one eye as ray-cast, and as encoded.
    render_size: vec2<u32>,
    output_size: vec2<u32>,
    // Bytes of a row of luma; that of chroma is half.
    luma_stride: u32,
    eye_count: u32,
    step_mm: f32,
    // Below this transmittance a ray ends.
    least_transmittance: f32,
    // Voxels along each axis.
    dims: vec3<f32>,
    // value = raw * value_scale + value_offset, raw as the texture gives it.
    value_scale: f32,
    // Cells of 4 voxels along each axis.
    cells: vec3<u32>,
    value_offset: f32,
    // Takes a gradient in index space to millimetres, up to a common factor.
    gradient_x: vec3<f32>,
    // table position = raw * table_scale + table_offset.
    table_scale: f32,
    gradient_y: vec3<f32>,
    table_offset: f32,
    gradient_z: vec3<f32>,
    threshold: f32,
    // ambient, diffuse, specular, power
    light: vec4<f32>,
    surface_color: vec3<f32>,
    surface_opacity: f32,
    background: vec3<f32>,
    window_low: f32,
    window_per_value: f32,
    room_mm_per_volume_mm: f32,
    depth_columns: u32,
    depth_rows: u32,
    // Pieces are lit alike for so many steps from the first with something to see, or until they have taken more than
    // `light_weight` of all light: 0 for each by itself.
    light_span: f32,
    // 1, or 0 to look at every sample although cells are empty: the same pipeline, so that the same bits come out.
    skip_empty: u32,
    // The part of a step that is gone at a time where there is more than little to see, and the opacity of a step that is
    // little.
    part: f32,
    little: f32,
    light_weight: f32,
    // How far red, green, blue and opacity of neighbouring rays may differ for the pixels between them to be interpolated.
    interpolated_below: f32,
    // A tile has 2 to this power rays along each side: 8, 4 or 2.
    tile_power: u32,
    // Of an integer format: numbers its range has, less 1, and what is added to them; 0, 0 of floats. Then slope and
    // intercept: value = stored * slope + intercept.
    stored: vec4<f32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
