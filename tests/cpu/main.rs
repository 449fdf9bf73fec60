//! Checks that need no Vulkan.

mod attributes_degenerate;
mod attributes_mesh;
mod attributes_neighbours;
mod attributes_normals;
mod attributes_radii;
mod attributes_shapes;
