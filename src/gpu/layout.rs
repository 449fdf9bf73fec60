//! Rust twins of the shaders' blocks, checked member by member against the reflected SPIR-V at compile time.

use std::mem::{offset_of, size_of};

use bytemuck::{Pod, Zeroable};

use super::spirv::generated as spirv;

/// Declares a `repr(C)` block and asserts that its members lie where the shader's do, and that none is missing.
macro_rules! block {
    ($(#[$meta:meta])* $name:ident = $module:ident { $($(#[$m:meta])* $field:ident: $ty:ty = $upper:ident),* $(,)? } pad $pad:literal) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
        pub struct $name {
            $($(#[$m])* pub $field: $ty,)*
            /// Fills the block up to a multiple of its alignment.
            pub padding: [u32; $pad],
        }
        $(const _: () = assert!(offset_of!($name, $field) == spirv::$module::$upper);)*
        const _: () = assert!([$(spirv::$module::$upper),*].len() == spirv::$module::MEMBERS);
    };
}

/// Views a frame can have; the size of the array in `glsl/shared/frame.glsl`.
pub const MAX_VIEWS: usize = 4;

block! {
    /// One cloud in one view; `glsl/shared/params.glsl` says what the members mean.
    DrawParams = draw_params {
        /// Row by row.
        eye_from_cloud: [[f32; 4]; 3] = EYE_FROM_CLOUD,
        /// In the cloud's coordinates.
        about: [f32; 4] = ABOUT,
        /// Row by row.
        pixel_hi: [[f32; 4]; 3] = PIXEL_HI,
        /// Row by row.
        pixel_lo: [[f32; 4]; 3] = PIXEL_LO,
        /// Row of pixel x.
        pixel_x: [f32; 4] = PIXEL_X,
        /// Row of pixel y.
        pixel_y: [f32; 4] = PIXEL_Y,
        /// Row of w.
        pixel_w: [f32; 4] = PIXEL_W,
        /// Centre of projection.
        eye: [f32; 4] = EYE,
        /// Ray of pixel (0, 0).
        ray_0: [f32; 4] = RAY_0,
        /// Its change with x.
        ray_x: [f32; 4] = RAY_X,
        /// Its change with y.
        ray_y: [f32; 4] = RAY_Y,
        /// Internal depth from linear depth.
        depth_map: [f32; 4] = DEPTH_MAP,
        /// Linear light.
        base_color: [f32; 4] = BASE_COLOR,
        /// \[px\]
        middle: [f32; 2] = MIDDLE,
        /// \[world units\]
        near: f32 = NEAR,
        /// Factor from stored to drawn radius.
        radius_scale: f32 = RADIUS_SCALE,
        /// \[world units\]
        tolerance_absolute: f32 = TOLERANCE_ABSOLUTE,
        /// In radii.
        tolerance_relative: f32 = TOLERANCE_RELATIVE,
        /// \[px\]
        low_pass: f32 = LOW_PASS,
        /// \[px\]
        sprite_limit: f32 = SPRITE_LIMIT,
        /// \[px\]
        pixel_size: f32 = PIXEL_SIZE,
        /// \[world units\]
        slab_near: f32 = SLAB_NEAR,
        /// \[world units\]
        slab_thickness: f32 = SLAB_THICKNESS,
        /// Number of slabs.
        slab_count: f32 = SLAB_COUNT,
        /// In the cloud's coordinates.
        test_eye: [f32; 4] = TEST_EYE,
        /// Error per distance that passes.
        tau: f32 = TAU,
        /// Bits of the largest radius, for packed clouds.
        radius_most: u32 = RADIUS_MOST,
        /// Bits from one code of a radius to the next.
        radius_step: u32 = RADIUS_STEP,
        /// Bits of a point's number within its slot, for layered point clouds.
        slot_shift: u32 = SLOT_SHIFT,
    } pad 32
}

block! {
    /// One view of the full-screen passes; `glsl/shared/frame.glsl` says what the members mean.
    ViewParams = view_params {
        /// Centre of projection.
        eye: [f32; 4] = EYE,
        /// Ray of pixel (0, 0).
        ray_0: [f32; 4] = RAY_0,
        /// Its change with x.
        ray_x: [f32; 4] = RAY_X,
        /// Its change with y.
        ray_y: [f32; 4] = RAY_Y,
        /// Internal depth from linear depth.
        depth_map: [f32; 4] = DEPTH_MAP,
        /// Host's depth from linear depth.
        host_depth: [f32; 4] = HOST_DEPTH,
    } pad 0
}

block! {
    /// The full-screen passes of one frame; `glsl/shared/frame.glsl` says what the members mean.
    FrameParams = frame_params {
        /// One entry a view.
        views: [ViewParams; MAX_VIEWS] = VIEWS,
        /// Direction and exponent.
        light: [f32; 4] = LIGHT,
        /// \[px\]
        offset: [f32; 2] = OFFSET,
        /// \[px\]
        extent: [i32; 2] = EXTENT,
        /// 0 to 1
        ambient: f32 = AMBIENT,
        /// 0 to 1
        specular: f32 = SPECULAR,
        /// Contrast.
        edl_strength: f32 = EDL_STRENGTH,
        /// \[px\]
        edl_radius: f32 = EDL_RADIUS,
    } pad 0
}

block! {
    /// What the counting pass found, in splats.
    Counts = counts {
        /// As sprites or ordinary quads.
        drawn: u32 = DRAWN,
        /// As quads whose fragments cast rays in eye space.
        too_large: u32 = TOO_LARGE,
        /// Outside the clip volume.
        outside: u32 = OUTSIDE,
        /// Facing away.
        back_face: u32 = BACK_FACE,
        /// Not a splat: NaN, infinity, radius zero.
        invalid: u32 = INVALID,
        /// Something finer or coarser stands for it.
        not_in_cut: u32 = NOT_IN_CUT,
    } pad 0
}

block! {
    /// Push constants of a run of points.
    RunPush = run_push {
        /// Compute: first point in the chunk, or first tile.
        first: u32 = FIRST,
        /// Compute: number of points.
        count: u32 = COUNT,
        /// Least stored radius.
        least: f32 = LEAST,
        /// Place in the table of cuts.
        table: u32 = TABLE,
    } pad 0
}

block! {
    /// A part of the list that compaction writes; `glsl/shared/list.glsl` says what the members mean.
    Range = range {
        /// Tile.
        first: u32 = FIRST,
        /// Number of tiles.
        tiles: u32 = TILES,
        /// Place in the list.
        base: u32 = BASE,
        /// Nothing.
        unused: u32 = UNUSED,
    } pad 0
}

block! {
    /// What draws such a part: `VkDrawIndexedIndirectCommand`, then `VkDrawIndirectCommand`.
    Command = command {
        /// Points.
        indices: u32 = INDICES,
        /// One.
        instances: u32 = INSTANCES,
        /// Place in the list.
        first_index: u32 = FIRST_INDEX,
        /// None.
        vertex_offset: u32 = VERTEX_OFFSET,
        /// None.
        first_instance: u32 = FIRST_INSTANCE,
        /// Six a point.
        vertices: u32 = VERTICES,
        /// One.
        quad_instances: u32 = QUAD_INSTANCES,
        /// Six times the place in the list.
        first_vertex: u32 = FIRST_VERTEX,
        /// None.
        first_quad_instance: u32 = FIRST_QUAD_INSTANCE,
    } pad 0
}

block! {
    /// Push constant of the passes that come before `composite`.
    PassPush = pass_push {
        /// Index of the view.
        view: u32 = VIEW,
        /// Layers of `groups`.
        layers: u32 = LAYERS,
    } pad 0
}

// std140 rounds a uniform block up to 16 bytes; the array stride of views is that of the struct.
const _: () = assert!(size_of::<DrawParams>() == 512 && size_of::<FrameParams>().is_multiple_of(16));
const _: () = assert!(size_of::<ViewParams>() * MAX_VIEWS == spirv::frame_params::LIGHT);
