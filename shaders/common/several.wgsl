// Several volumes of one patient: what each is on its own grid. Points are in the index space of the first volume unless
// they are said to be a part's own.
//
// The text is made for the volumes that a scene has, `Several` in shaders.rs says how: what stands between `#each` and
// `#end` comes once for each of them, `$` being its number. A software driver keeps what is looked up by number in memory,
// and goes through all branches of a choice between textures; so nothing is looked up by number here.

// A volume that is shown. The Rust mirror is `GpuPart`; a test compares the layouts.
struct Part {
    // Columns that take an index of the first volume to this one's.
    column_x: vec3<f32>,
    value_scale: f32,
    column_y: vec3<f32>,
    value_offset: f32,
    column_z: vec3<f32>,
    table_scale: f32,
    shift: vec3<f32>,
    table_offset: f32,
    // Voxels along each axis.
    dims: vec3<f32>,
    // Where its stretches of the transfer function lie, or its labels' looks.
    first_stretch: u32,
    // Cells along each axis.
    cells: vec3<u32>,
    stretches: u32,
    // Takes a gradient by own index to millimetres, up to a common factor.
    gradient_x: vec3<f32>,
    // Its smallest voxel spacing.
    finest_mm: f32,
    gradient_y: vec3<f32>,
    gradient_z: vec3<f32>,
    // ambient, diffuse, specular, power
    light: vec4<f32>,
    // As the frame has it of one volume.
    stored: vec4<f32>,
}

@group(1) @binding(0) var<uniform> parts: array<Part, 4>;

#each
@group(2) @binding($) var distance_to_seen_$: texture_3d<u32>;
#end

// Voxels along a side of a cell.
const CELL: f32 = 4.0;
// How near the border of a cell, in voxels, a sample is held to be outside: more than float32 can err by.
const CELL_MARGIN: f32 = 1.0e-3;

// A vector by index of the first volume, in a part.
fn own_vector(k: u32, v: vec3<f32>) -> vec3<f32> {
    return parts[k].column_x * v.x + parts[k].column_y * v.y + parts[k].column_z * v.z;
}

fn own_point(k: u32, p: vec3<f32>) -> vec3<f32> {
    return own_vector(k, p) + parts[k].shift;
}

// The cell that an own point of a part lies in.
fn own_cell(k: u32, p: vec3<f32>) -> vec3<i32> {
    let last = vec3<i32>((parts[k].dims - 1.0) / CELL);
    return clamp(vec3<i32>(floor(p / CELL)), vec3<i32>(0), last);
}

// Cells between a cell of a part and the nearest one with something in it; 0: this one.
#each
fn reach_of_$(cell: vec3<i32>) -> u32 {
    return textureLoad(distance_to_seen_$, cell, 0).r * frame.skip_empty;
}
#end
