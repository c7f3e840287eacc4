//! Engines against the reference, the streamer under faults, and the renderer across pictures.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "tests use small numbers"
)]
#![allow(clippy::unwrap_used, reason = "tests fail loudly")]

mod containers;
mod cpu_against_reference;
mod cpu_invariances;
mod cut_normals;
mod deadline;
mod engines;
mod gpu_contracts;
mod gpu_errors;
mod gpu_images;
mod gpu_places;
mod gpu_recast;
mod gpu_support;
mod gpu_twin_list;
mod gpu_twins;
mod gpu_walk_twins;
mod gradient_opacity;
mod inner_surfaces;
mod packed_bricks;
mod packet_modes;
mod picking;
mod reference_accuracy;
mod reference_closed_forms;
mod renderer;
mod shading_closed_form;
mod slices;
mod solids;
mod spans;
mod streaming_convergence;
mod streaming_faults;
mod streaming_gpu;
mod streaming_states;
mod support;
mod what_is_refined;
mod work;
