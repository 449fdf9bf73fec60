//! Tests that need no Vulkan.

mod cli;
#[path = "../common/mod.rs"]
mod common;
mod convergence;
mod e57_files;

mod arrows;
mod attributes_degenerate;
mod attributes_mesh;
mod attributes_neighbours;
mod attributes_normals;
mod attributes_radii;
mod attributes_shapes;
#[path = "../common/folder.rs"]
mod folder;
mod golden;
mod groups;
mod groups_file;
mod http_nginx;
mod hybrid;
#[path = "../common/hybrid.rs"]
mod hybrid_common;
mod hybrid_file;
#[path = "../common/golden.rs"]
mod kept;
mod layered;
mod layered_budget;
mod layered_build;
mod layered_cache;
mod layered_common;
mod layered_fade;
mod layered_file;
mod layered_groups;
mod layered_in_view;
mod layered_refine;
mod load_bad;
mod load_e57;
mod load_e57_bad;
mod load_files;
mod load_las;
mod load_merge;
mod load_pieces;
mod load_ply;
mod load_sample;
mod load_synthetic;
#[path = "../common/nginx.rs"]
mod nginx;
mod octree;
mod octree_file;
mod octree_levels;
mod packing;
mod reference_blends;
mod reference_common;
mod reference_fragments;
mod reference_fuzzy;
mod reference_groups;
mod reference_light;
mod reference_oracle;
mod reference_rounding;
mod reference_sensitivity;
mod reference_supersampled;
mod reference_truth;
mod scene_files;
mod sequential;
mod sequential_file;
mod sequential_views;
mod server;
mod stream_fetch;
mod stream_file;
mod stream_http;
mod written;
