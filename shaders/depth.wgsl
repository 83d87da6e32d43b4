// A coarse grid of depths for each eye, so that a headset can shift a late picture: millimetres of room, as 16 bits,
// 0 where nothing is seen.

@group(1) @binding(0) var depth_mm: texture_2d_array<f32>;
@group(1) @binding(1) var picture: texture_2d_array<f32>;
@group(1) @binding(2) var<storage, read_write> grid: array<u32>;

// The depth along the ray through the cell's middle.
fn cell_depth(eye: u32, column: u32, row: u32) -> u32 {
    let middle = (vec2<u32>(column, row) * 2u + 1u) * frame.render_size
        / (2u * vec2<u32>(frame.depth_columns, frame.depth_rows));
    let pixel = min(middle, frame.render_size - 1u);
    let depth = textureLoad(depth_mm, pixel, eye, 0).r;
    if (!(depth > 0.0) || !(textureLoad(picture, pixel, eye, 0).a > 0.0)) {
        return 0u;
    }
    return u32(clamp(depth * frame.room_mm_per_volume_mm + 0.5, 1.0, 65535.0));
}

// Two cells a word.
@compute @workgroup_size(64)
fn reduce(@builtin(global_invocation_id) id: vec3<u32>) {
    let cells_an_eye = frame.depth_columns * frame.depth_rows;
    let first = id.x * 2u;
    if (first >= cells_an_eye * frame.eye_count) {
        return;
    }
    var word = 0u;
    for (var k = 0u; k < 2u; k += 1u) {
        let cell = first + k;
        if (cell < cells_an_eye * frame.eye_count) {
            let inside = cell % cells_an_eye;
            let depth = cell_depth(cell / cells_an_eye, inside % frame.depth_columns, inside / frame.depth_columns);
            word |= depth << (16u * k);
        }
    }
    grid[id.x] = word;
}
