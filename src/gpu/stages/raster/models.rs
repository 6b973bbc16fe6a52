//! The models of a virtual scene on the device: uploaded once, and again only when a model is new.

use crate::gpu::{Gpu, GpuBuffer, GpuError, uniform};
use crate::math::color::LINEAR_FROM_SRGB8;
use crate::scene::{Model, Texture, VirtualScene, Wrap};
use std::sync::Arc;

/// Of numbers from files; beyond it products would overflow.
const LARGEST_COLOR: f32 = 1e9;

uniform! {
    /// As in `shaders/raster/scene.wgsl`.
    pub struct Vertex {
        position: [f32; 3],
        u: f32,
        normal: [f32; 3],
        v: f32,
        color: [f32; 4],
    }
}

/// Where a texture lies in the list of texels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TexturePlace {
    pub first_texel: u32,
    pub size: [u32; 2],
    /// 0: no texture.
    pub levels: u32,
    /// Numbers of the modes along u and v.
    pub wrap: [u32; 2],
}

/// Where a model lies in the lists.
pub struct ModelPlace {
    pub first_triangle: u32,
    /// One a part.
    pub textures: Vec<TexturePlace>,
}

/// All vertices, triangles and texels, each kind in one buffer.
pub struct GpuModels {
    places: Vec<(Arc<Model>, ModelPlace)>,
    pub vertices: GpuBuffer<Vertex>,
    /// Three indices of vertices each.
    pub triangles: GpuBuffer<u32>,
    /// Bits of the sRGB curve, then texels of four bytes.
    pub texels: GpuBuffer<u32>,
}

#[derive(Default)]
struct Lists {
    vertices: Vec<Vertex>,
    triangles: Vec<u32>,
    texels: Vec<u32>,
    textures: Vec<(Arc<Texture>, TexturePlace)>,
}

impl GpuModels {
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Self::of(gpu, &VirtualScene::default())
    }

    fn of(gpu: &Gpu, scene: &VirtualScene) -> Result<Self, GpuError> {
        let curve = LINEAR_FROM_SRGB8.iter().map(|light| light.to_bits()).collect();
        let mut lists = Lists { texels: curve, ..Lists::default() };
        let mut places: Vec<(Arc<Model>, ModelPlace)> = Vec::new();
        for object in &scene.objects {
            if !places.iter().any(|(model, _)| Arc::ptr_eq(model, &object.model)) {
                places.push((object.model.clone(), lists.add(&object.model)));
            }
        }
        // a binding may not be empty
        lists.vertices.resize(lists.vertices.len().max(1), bytemuck::Zeroable::zeroed());
        lists.triangles.resize(lists.triangles.len().max(3), 0);
        Ok(Self {
            places,
            vertices: GpuBuffer::from_slice(gpu, "vertices of models", &lists.vertices)?,
            triangles: GpuBuffer::from_slice(gpu, "triangles of models", &lists.triangles)?,
            texels: GpuBuffer::from_slice(gpu, "textures of models", &lists.texels)?,
        })
    }

    /// Uploads everything anew where an object shows a model that is not there.
    pub fn follow(&mut self, gpu: &Gpu, scene: &VirtualScene) -> Result<(), GpuError> {
        if scene.objects.iter().any(|object| self.place(&object.model).is_none()) {
            *self = Self::of(gpu, scene)?;
        }
        Ok(())
    }

    pub fn place(&self, model: &Arc<Model>) -> Option<&ModelPlace> {
        let mut places = self.places.iter();
        places.find(|(known, _)| Arc::ptr_eq(known, model)).map(|(_, place)| place)
    }
}

impl Lists {
    fn add(&mut self, model: &Model) -> ModelPlace {
        let first_vertex = self.vertices.len() as u32;
        let first_triangle = (self.triangles.len() / 3) as u32;
        let colors = model.colors();
        self.vertices.extend(model.vertices().iter().enumerate().map(|(i, v)| Vertex {
            position: v.position.to_array(),
            u: v.uv.x,
            normal: v.normal.to_array(),
            v: v.uv.y,
            color: colors.get(i).map_or([1.0; 4], |&color| finite(color)),
        }));
        let indices = model.triangles().as_flattened();
        self.triangles.extend(indices.iter().map(|i| first_vertex + i));
        let parts = model.parts().iter();
        let textures = parts.map(|part| match &part.material.texture {
            Some(texture) => self.texture(texture),
            None => TexturePlace::default(),
        });
        ModelPlace { first_triangle, textures: textures.collect() }
    }

    /// Textures that parts share are uploaded once.
    fn texture(&mut self, texture: &Arc<Texture>) -> TexturePlace {
        let mut known = self.textures.iter();
        if let Some((_, place)) = known.find(|(known, _)| Arc::ptr_eq(known, texture)) {
            return *place;
        }
        let levels = texture.levels();
        let place = TexturePlace {
            first_texel: self.texels.len() as u32,
            size: levels.clone().next().map_or([0; 2], |(w, h, _)| [w as u32, h as u32]),
            levels: levels.clone().count() as u32,
            wrap: texture.wrap().map(|wrap| match wrap {
                Wrap::Repeat => 0,
                Wrap::MirroredRepeat => 1,
                Wrap::ClampToEdge => 2,
            }),
        };
        for (_, _, texels) in levels {
            self.texels.extend(texels.iter().map(|&texel| u32::from_le_bytes(texel)));
        }
        self.textures.push((texture.clone(), place));
        place
    }
}

/// Shaders may take what is no number for anything.
pub fn finite(color: [f32; 4]) -> [f32; 4] {
    color.map(|c| if c.is_nan() { 0.0 } else { c.clamp(-LARGEST_COLOR, LARGEST_COLOR) })
}
