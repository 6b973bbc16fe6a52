//! Parameter structs that Rust and WGSL both declare.

/// A member of a parameter struct.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    pub name: &'static str,
    /// Bytes from the struct's start.
    pub offset: usize,
    pub bytes: usize,
}

/// A struct of a shader, with WGSL's layout. Made by the macro `uniform!`; at every pass its name, members,
/// offsets and sizes are compared with those of the shader.
pub trait Uniform: bytemuck::Pod {
    const NAME: &'static str;
    const FIELDS: &'static [Field];
}

/// Declares a struct that shaders declare too: same name, same members in the same order.
///
/// Members are `f32`, `i32`, `u32`, `[_; 2]` (vec2), `[_; 4]` (vec4), `[[f32; 4]; 4]` (mat4x4, columns) or
/// another such struct. WGSL aligns more than `repr(C)` does; members that would not lie where
/// WGSL wants them are found at the first pass that binds the struct, and padding is written out.
macro_rules! uniform {
    ($(#[$doc:meta])* $vis:vis struct $name:ident { $($(#[$field_doc:meta])* $field:ident: $type:ty),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        #[repr(C)]
        $vis struct $name { $($(#[$field_doc])* pub $field: $type),+ }

        impl $crate::gpu::Uniform for $name {
            const NAME: &'static str = stringify!($name);
            const FIELDS: &'static [$crate::gpu::Field] = &[$($crate::gpu::Field {
                name: stringify!($field),
                offset: std::mem::offset_of!($name, $field),
                bytes: size_of::<$type>(),
            }),+];
        }
    };
}
pub(crate) use uniform;
