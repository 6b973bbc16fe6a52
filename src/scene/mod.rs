//! Virtual objects: loading, placing, rasterising into geometry buffers; and analytic scenes whose
//! buffers are known exactly.

pub mod analytic;
