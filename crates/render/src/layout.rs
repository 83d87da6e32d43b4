//! What the shaders read: mirrors of the structs in `shaders/common/frame.wgsl`.

use bytemuck::{Pod, Zeroable};

/// `Eye` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct GpuEye {
    pub(crate) anchor: [f32; 3],
    pub(crate) anchor_depth: f32,
    pub(crate) ray: [f32; 3],
    pub(crate) near: f32,
    pub(crate) ray_dx: [f32; 3],
    pub(crate) far: f32,
    pub(crate) ray_dy: [f32; 3],
    pub(crate) pad_2: u32,
    pub(crate) ray_mm: [f32; 3],
    pub(crate) pad_3: u32,
    pub(crate) ray_dx_mm: [f32; 3],
    pub(crate) pad_4: u32,
    pub(crate) ray_dy_mm: [f32; 3],
    pub(crate) pad_5: u32,
}

/// `Frame` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct GpuFrame {
    pub(crate) eyes: [GpuEye; 2],
    pub(crate) render_size: [u32; 2],
    pub(crate) output_size: [u32; 2],
    pub(crate) luma_stride: u32,
    pub(crate) eye_count: u32,
    pub(crate) step_mm: f32,
    pub(crate) least_transmittance: f32,
    pub(crate) dims: [f32; 3],
    pub(crate) value_scale: f32,
    pub(crate) cells: [u32; 3],
    pub(crate) value_offset: f32,
    pub(crate) gradient_x: [f32; 3],
    pub(crate) table_scale: f32,
    pub(crate) gradient_y: [f32; 3],
    pub(crate) table_offset: f32,
    pub(crate) gradient_z: [f32; 3],
    pub(crate) threshold: f32,
    pub(crate) light: [f32; 4],
    pub(crate) surface_color: [f32; 3],
    pub(crate) surface_opacity: f32,
    pub(crate) background: [f32; 3],
    pub(crate) window_low: f32,
    pub(crate) window_per_value: f32,
    pub(crate) room_mm_per_volume_mm: f32,
    pub(crate) depth_columns: u32,
    pub(crate) depth_rows: u32,
    pub(crate) light_span: f32,
    pub(crate) skip_empty: u32,
    pub(crate) part: f32,
    pub(crate) little: f32,
    pub(crate) light_weight: f32,
    pub(crate) interpolated_below: f32,
    pub(crate) tile_power: u32,
    pub(crate) pad: u32,
    pub(crate) stored: [f32; 4],
}

/// `Stretch` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct GpuStretch {
    pub(crate) value_from: f32,
    pub(crate) value_to: f32,
    pub(crate) opacity_from: f32,
    pub(crate) opacity_to: f32,
    pub(crate) color_from: [f32; 3],
    pub(crate) per_value: f32,
    pub(crate) color_to: [f32; 3],
    pub(crate) seen_before: u32,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shaders::{self, PartKind};
    use crate::targets::{FIRST_GROUPS_AT, WORK_HEAD_BYTES};
    use std::mem::{offset_of, size_of};

    /// Members of a WGSL struct (name, offset in bytes) and its size, as naga lays it out.
    fn wgsl_struct(name: &str) -> (Vec<(String, u32)>, u32) {
        wgsl_struct_in(shaders::RAYCAST, name)
    }

    fn wgsl_struct_in(text: &str, name: &str) -> (Vec<(String, u32)>, u32) {
        let module = naga::front::wgsl::parse_str(text).unwrap();
        let (_, found) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name)).unwrap();
        let naga::TypeInner::Struct { members, span } = &found.inner else { panic!("{name} is no struct") };
        (members.iter().map(|m| (m.name.clone().unwrap(), m.offset)).collect(), *span)
    }

    macro_rules! members {
        ($t:ty: $($m:ident),*) => { vec![$((stringify!($m).to_owned(), offset_of!($t, $m) as u32)),*] };
    }

    #[test]
    fn eye_lies_in_memory_as_the_shader_reads_it() {
        let rust = members!(GpuEye: anchor, anchor_depth, ray, near, ray_dx, far, ray_dy, ray_mm, ray_dx_mm, ray_dy_mm);
        assert_eq!(wgsl_struct("Eye"), (rust, size_of::<GpuEye>() as u32));
    }

    #[test]
    fn frame_lies_in_memory_as_the_shader_reads_it() {
        let rust = members!(GpuFrame: eyes, render_size, output_size, luma_stride, eye_count, step_mm,
            least_transmittance, dims, value_scale, cells, value_offset, gradient_x, table_scale, gradient_y,
            table_offset, gradient_z, threshold, light, surface_color, surface_opacity, background, window_low,
            window_per_value, room_mm_per_volume_mm, depth_columns, depth_rows, light_span, skip_empty, part,
            little, light_weight, interpolated_below, tile_power, stored);
        assert_eq!(wgsl_struct("Frame"), (rust, size_of::<GpuFrame>() as u32));
    }

    #[test]
    fn stretch_lies_in_memory_as_the_shader_reads_it() {
        let rust = members!(GpuStretch: value_from, value_to, opacity_from, opacity_to, color_from, per_value,
            color_to, seen_before);
        assert_eq!(wgsl_struct("Stretch"), (rust, size_of::<GpuStretch>() as u32));
    }

    #[test]
    fn lists_of_work_lie_in_memory_as_every_shader_has_them() {
        let kinds = [PartKind { labels: false, many_labels: false, lit: false }; 2];
        let (several, several_tiles) = (shaders::several(&kinds), shaders::several_tiles(kinds.len()));
        for (what, text, name, first, entries) in [
            ("tiles", shaders::TILES, "Work", "first_x", "tiles"),
            ("tiles of several", &several_tiles, "Work", "first_x", "tiles"),
            ("raycast", shaders::RAYCAST, "Work", "first_groups", "tiles"),
            ("several", &several, "Work", "first_groups", "tiles"),
            ("spread", shaders::SPREAD, "Work", "first_groups", "tiles"),
            ("spread", shaders::SPREAD, "Rest", "unused_x", "pixels"),
        ] {
            let (members, _) = wgsl_struct_in(text, name);
            let at = |member: &str| members.iter().find(|(n, _)| n == member).map(|(_, at)| u64::from(*at));
            assert_eq!(at(first), Some(FIRST_GROUPS_AT), "{what}: {name}.{first}");
            assert_eq!(at(entries), Some(WORK_HEAD_BYTES), "{what}: {name}.{entries}");
            // What is dispatched comes first, then how many entries there are.
            let count = if name == "Rest" { "pixel_count" } else { "tile_count" };
            assert_eq!((members[0].1, at(count)), (0, Some(12)), "{what}: {name}");
        }
    }
}
