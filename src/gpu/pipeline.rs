//! From a shader's text to a pipeline: parsed once, so that bindings are what the shader says they are.

use super::profile::{Counted, instrument};
use super::{Gpu, GpuError, Shader, Uniform};
use naga::{AddressSpace, ImageClass, ImageDimension, ScalarKind, StorageAccess, TypeInner};
use std::sync::Arc;

/// How a shader uses a binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Access {
    Uniform,
    Read,
    ReadWrite,
    /// Layers of a picture of unsigned numbers.
    Layers,
}

/// One `var` of a shader's bind group 0.
pub(super) struct BindingInfo {
    pub name: String,
    pub access: Access,
    /// Of a uniform: struct, members with offset and size, and whole size.
    layout: Option<StructLayout>,
}

struct StructLayout {
    name: String,
    members: Vec<(String, usize, usize)>,
    bytes: usize,
}

/// What a shader says about itself.
pub(super) struct Reflection {
    /// In the order of their numbers, which run from 0 without a gap.
    pub bindings: Vec<BindingInfo>,
    pub workgroup: [u32; 3],
}

impl Reflection {
    /// Of a compute shader: one function `main`.
    pub fn of(shader: &Shader, module: &naga::Module) -> Result<Self, GpuError> {
        let main = entry_point(shader, module, "main")?;
        Self::with_workgroup(shader, module, main.workgroup_size)
    }

    /// Of a shader that draws: functions `vertex_main` and `fragment_main`.
    pub fn of_drawing(shader: &Shader, module: &naga::Module) -> Result<Self, GpuError> {
        for name in ["vertex_main", "fragment_main"] {
            entry_point(shader, module, name)?;
        }
        Self::with_workgroup(shader, module, [0; 3])
    }

    fn with_workgroup(
        shader: &Shader,
        module: &naga::Module,
        workgroup: [u32; 3],
    ) -> Result<Self, GpuError> {
        let wrong = |problem: String| GpuError::Shader { shader: shader.file.into(), problem };
        let mut numbered = Vec::new();
        for (_, variable) in module.global_variables.iter() {
            let Some(binding) = &variable.binding else { continue };
            if binding.group != 0 {
                return Err(wrong("only bind group 0 is used".into()));
            }
            let name = variable.name.clone().unwrap_or_default();
            let access = match variable.space {
                AddressSpace::Uniform => Access::Uniform,
                AddressSpace::Storage { access } if access.contains(StorageAccess::STORE) => {
                    Access::ReadWrite
                }
                AddressSpace::Storage { .. } => Access::Read,
                AddressSpace::Handle if is_layers(&module.types[variable.ty].inner) => {
                    Access::Layers
                }
                _ => return Err(wrong(format!("{name} is nothing that can be bound"))),
            };
            let layout = (access == Access::Uniform)
                .then(|| StructLayout::of(module, variable.ty))
                .flatten();
            numbered.push((binding.binding, BindingInfo { name, access, layout }));
        }
        numbered.sort_by_key(|(number, _)| *number);
        if numbered.iter().enumerate().any(|(i, (number, _))| i as u32 != *number) {
            return Err(wrong("bindings are not numbered 0, 1, 2, ...".into()));
        }
        let bindings = numbered.into_iter().map(|(_, info)| info).collect();
        Ok(Self { bindings, workgroup })
    }

    #[cfg(test)]
    pub fn storage_bindings(&self) -> usize {
        let storage = [Access::Read, Access::ReadWrite];
        self.bindings.iter().filter(|b| storage.contains(&b.access)).count()
    }
}

fn entry_point<'m>(
    shader: &Shader,
    module: &'m naga::Module,
    name: &str,
) -> Result<&'m naga::EntryPoint, GpuError> {
    module.entry_points.iter().find(|e| e.name == name).ok_or_else(|| GpuError::Shader {
        shader: shader.file.into(),
        problem: format!("it has no function {name}"),
    })
}

/// Whether this is `texture_2d_array<u32>`.
fn is_layers(ty: &TypeInner) -> bool {
    matches!(
        ty,
        TypeInner::Image {
            dim: ImageDimension::D2,
            arrayed: true,
            class: ImageClass::Sampled { kind: ScalarKind::Uint, multi: false },
        }
    )
}

impl StructLayout {
    fn of(module: &naga::Module, ty: naga::Handle<naga::Type>) -> Option<Self> {
        let ty = &module.types[ty];
        let TypeInner::Struct { members, span } = &ty.inner else { return None };
        let context = module.to_ctx();
        let members = members.iter().map(|m| {
            let bytes = module.types[m.ty].inner.size(context) as usize;
            (m.name.clone().unwrap_or_default(), m.offset as usize, bytes)
        });
        let name = ty.name.clone().unwrap_or_default();
        Some(Self { name, members: members.collect(), bytes: *span as usize })
    }

    /// What does not agree with the struct of the Rust side.
    fn against<T: Uniform>(&self) -> Result<(), String> {
        if self.name != T::NAME {
            return Err(format!("the shader wants a {}, Rust binds a {}", self.name, T::NAME));
        }
        let rust = T::FIELDS.iter().map(|f| (f.name, f.offset, f.bytes));
        let wgsl =
            self.members.iter().map(|(name, offset, bytes)| (name.as_str(), *offset, *bytes));
        if let Some((r, w)) = rust.clone().zip(wgsl.clone()).find(|(r, w)| r != w) {
            return Err(format!(
                "{}: member, offset, bytes are {r:?} in Rust and {w:?} in the shader",
                self.name
            ));
        }
        let (r, w) = ((rust.count(), size_of::<T>()), (wgsl.count(), self.bytes));
        if r != w {
            return Err(format!(
                "{}: members and bytes are {r:?} in Rust and {w:?} in the shader",
                self.name
            ));
        }
        Ok(())
    }
}

/// A shader that is ready to run; `R` is what wgpu makes of it.
pub struct Pipeline<R = wgpu::ComputePipeline> {
    pub(super) shader: Shader,
    pub(super) reflection: Reflection,
    pub(super) layout: wgpu::BindGroupLayout,
    pub(super) raw: R,
    /// Of a shader that counts what it does.
    pub(super) counted: Option<Counted>,
}

impl<R> Pipeline<R> {
    pub(super) fn binding_error(&self, binding: usize, problem: String) -> GpuError {
        GpuError::Binding { shader: self.shader.file.to_owned(), binding, problem }
    }

    /// Whether the next binding is used as the caller means to.
    pub(super) fn expect(&self, binding: usize, access: Access) -> Result<(), GpuError> {
        match self.reflection.bindings.get(binding) {
            Some(info) if info.access == access => Ok(()),
            Some(info) => Err(self.binding_error(
                binding,
                format!("{} is {:?} in the shader and bound as {access:?}", info.name, info.access),
            )),
            None => Err(self.binding_error(binding, "the shader has no such binding".into())),
        }
    }

    pub(super) fn expect_uniform<T: Uniform>(&self, binding: usize) -> Result<(), GpuError> {
        self.expect(binding, Access::Uniform)?;
        let layout = self.reflection.bindings[binding].layout.as_ref();
        let agrees = layout.ok_or_else(|| "it is no struct in the shader".to_owned());
        agrees.and_then(|l| l.against::<T>()).map_err(|e| self.binding_error(binding, e))
    }

    /// Makes the layout of the bindings, and leaves the pipeline itself to `make`.
    pub(super) fn with(
        gpu: &Gpu,
        shader: &Shader,
        reflection: Reflection,
        counted: Option<Counted>,
        visibility: wgpu::ShaderStages,
        make: impl FnOnce(&wgpu::PipelineLayout) -> R,
    ) -> Result<Arc<Self>, GpuError> {
        let bindings = reflection.bindings.iter().enumerate();
        let entries: Vec<_> = bindings.map(|(i, info)| layout_entry(i, info, visibility)).collect();
        let layout = gpu.device().create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(shader.file),
            entries: &entries,
        });
        let pipeline_layout =
            gpu.device().create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(shader.file),
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            });
        let raw = make(&pipeline_layout);
        gpu.check()?;
        Ok(Arc::new(Self { shader: shader.clone(), reflection, layout, raw, counted }))
    }
}

impl Pipeline {
    pub(super) fn compile(gpu: &Gpu, shader: &Shader) -> Result<Arc<Self>, GpuError> {
        let mut module = parse(shader)?;
        let counted = match gpu.counts_work() {
            true => Some(replace_by_counting(shader, &mut module)?),
            false => None,
        };
        let reflection = Reflection::of(shader, &module)?;
        let module = gpu.device().create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(shader.file),
            source: wgpu::ShaderSource::Naga(std::borrow::Cow::Owned(module)),
        });
        Self::with(gpu, shader, reflection, counted, wgpu::ShaderStages::COMPUTE, |layout| {
            gpu.device().create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(shader.file),
                layout: Some(layout),
                module: &module,
                entry_point: Some("main"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            })
        })
    }
}

fn replace_by_counting(shader: &Shader, module: &mut naga::Module) -> Result<Counted, GpuError> {
    let (counting, counted) = instrument(module)
        .map_err(|problem| GpuError::Shader { shader: shader.file.to_owned(), problem })?;
    *module = counting;
    Ok(counted)
}

/// Parses the composed text; an error shows the line.
pub(super) fn parse(shader: &Shader) -> Result<naga::Module, GpuError> {
    let text = shader.compose()?;
    naga::front::wgsl::parse_str(&text).map_err(|error| GpuError::Shader {
        shader: shader.file.to_owned(),
        problem: error.emit_to_string(&text),
    })
}

/// What does not agree between a struct of the shader and Rust's: for those in storage buffers, which passes
/// don't compare.
#[cfg(test)]
pub(super) fn compare_struct<T: Uniform>(shader: &Shader) -> Result<(), String> {
    let module = parse(shader).map_err(|e| e.to_string())?;
    let found = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(T::NAME));
    let (handle, _) = found.ok_or_else(|| format!("there is no {} in the shader", T::NAME))?;
    let layout = StructLayout::of(&module, handle);
    layout.ok_or_else(|| format!("{} is no struct", T::NAME))?.against::<T>()
}

fn layout_entry(
    number: usize,
    info: &BindingInfo,
    visibility: wgpu::ShaderStages,
) -> wgpu::BindGroupLayoutEntry {
    let bytes = info.layout.as_ref().map_or(0, |l| l.bytes as u64);
    let buffer = |ty| wgpu::BindingType::Buffer {
        ty,
        has_dynamic_offset: false,
        min_binding_size: std::num::NonZeroU64::new(bytes),
    };
    let ty = match info.access {
        Access::Uniform => buffer(wgpu::BufferBindingType::Uniform),
        Access::Read => buffer(wgpu::BufferBindingType::Storage { read_only: true }),
        Access::ReadWrite => buffer(wgpu::BufferBindingType::Storage { read_only: false }),
        Access::Layers => wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Uint,
            view_dimension: wgpu::TextureViewDimension::D2Array,
            multisampled: false,
        },
    };
    wgpu::BindGroupLayoutEntry { binding: number as u32, visibility, ty, count: None }
}
