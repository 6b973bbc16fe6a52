//! Base colour of glTF materials.

use super::Source;
use super::accessor::Buffers;
use super::budget;
use super::container::read_uri;
use crate::image::encoded::{self, USUAL};
use crate::scene::model::Material;
use crate::scene::texture::{Texture, Wrap};
use glam::Vec2;
use gltf::material::AlphaMode;
use gltf::texture::WrappingMode;
use std::collections::HashMap;
use std::sync::Arc;

/// 8-bit RGBA of this side squared takes 1 GiB.
const MAX_TEXTURE_SIDE: usize = 16_384;

/// A material, and how a primitive's texture coordinates become those of its texture.
#[derive(Clone, Debug, Default)]
pub struct MaterialSource {
    pub material: Material,
    pub tex_coord: u32,
    pub uv_transform: Option<UvTransform>,
}

/// `KHR_texture_transform`: scale, then rotation, then offset.
#[derive(Clone, Copy, Debug)]
pub struct UvTransform {
    offset: Vec2,
    rotation: f32,
    scale: Vec2,
}

impl UvTransform {
    /// Positive rotation is counter-clockwise on the picture, where v goes down.
    pub fn apply(&self, uv: Vec2) -> Vec2 {
        let (sin, cos) = self.rotation.sin_cos();
        let uv = uv * self.scale;
        self.offset + Vec2::new(cos * uv.x + sin * uv.y, cos * uv.y - sin * uv.x)
    }
}

/// Reads materials when primitives ask for them, each texture once.
pub struct Materials<'a> {
    source: &'a Source<'a>,
    buffers: &'a Buffers,
    textures: HashMap<usize, Arc<Texture>>,
    blend_said: bool,
}

impl<'a> Materials<'a> {
    pub fn new(source: &'a Source<'a>, buffers: &'a Buffers) -> Self {
        Self { source, buffers, textures: HashMap::new(), blend_said: false }
    }

    pub fn get(&mut self, material: &gltf::Material) -> Result<MaterialSource, String> {
        let pbr = material.pbr_metallic_roughness();
        let alpha_cutoff = match material.alpha_mode() {
            AlphaMode::Opaque => None,
            AlphaMode::Mask => Some(material.alpha_cutoff().unwrap_or(0.5)),
            AlphaMode::Blend => {
                if !std::mem::replace(&mut self.blend_said, true) {
                    log::warn!(
                        "{}: transparency is drawn as a mask: opaque where alpha is at least 0.5",
                        self.source.path.display()
                    );
                }
                Some(0.5)
            }
        };
        let base_color = pbr.base_color_factor();
        let mut out = MaterialSource {
            material: Material { base_color, texture: None, alpha_cutoff },
            ..Default::default()
        };
        if let Some(info) = pbr.base_color_texture() {
            out.tex_coord = info.tex_coord();
            if let Some(transform) = material.index().and_then(|i| self.source.uv_transform(i)) {
                let pair = |key: &str, default| {
                    let value = |i: usize| transform.get(key)?.get(i)?.as_f64();
                    value(0).zip(value(1)).map_or(default, |(x, y)| Vec2::new(x as f32, y as f32))
                };
                let number = |key: &str| transform.get(key).and_then(serde_json::Value::as_f64);
                out.uv_transform = Some(UvTransform {
                    offset: pair("offset", Vec2::ZERO),
                    rotation: number("rotation").unwrap_or(0.0) as f32,
                    scale: pair("scale", Vec2::ONE),
                });
                if let Some(set) = number("texCoord") {
                    out.tex_coord = set as u32;
                }
            }
            out.material.texture = Some(self.texture(&info.texture())?);
        }
        Ok(out)
    }

    fn texture(&mut self, texture: &gltf::Texture) -> Result<Arc<Texture>, String> {
        if let Some(known) = self.textures.get(&texture.index()) {
            return Ok(known.clone());
        }
        let image = texture.source().index();
        let problem = |what: String| format!("image {image}: {what}");
        let picture = self.decode(&self.image_bytes(image).map_err(problem)?).map_err(problem)?;
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let texels = picture.pixels().map(|p| p.0).collect();
        let wrap =
            [texture.sampler().wrap_s(), texture.sampler().wrap_t()].map(|mode| match mode {
                WrappingMode::Repeat => Wrap::Repeat,
                WrappingMode::MirroredRepeat => Wrap::MirroredRepeat,
                WrappingMode::ClampToEdge => Wrap::ClampToEdge,
            });
        let loaded = Texture::new(width, height, texels, wrap)
            .ok_or_else(|| problem("has no pixels".to_owned()))?;
        let loaded = Arc::new(loaded);
        self.textures.insert(texture.index(), loaded.clone());
        Ok(loaded)
    }

    /// The JSON is read directly: the typed wrapper panics where neither view nor URI is given.
    fn image_bytes(&self, index: usize) -> Result<Vec<u8>, String> {
        let document = self.source.document;
        let image = &document.as_json().images[index];
        match (&image.buffer_view, &image.uri) {
            (Some(view), _) => {
                let view =
                    document.views().nth(view.value()).ok_or("its buffer view is missing")?;
                self.buffers.view(&view).map(<[u8]>::to_vec)
            }
            (None, Some(uri)) => read_uri(uri, self.source.folder, &self.buffers.budget),
            (None, None) => Err("has neither a buffer view nor a URI".to_owned()),
        }
    }

    fn decode(&self, bytes: &[u8]) -> Result<image::RgbaImage, String> {
        let (decoder, size) = encoded::open(bytes, USUAL)?;
        if size.width.max(size.height) > MAX_TEXTURE_SIDE {
            return Err(format!("{size} pixels; a side may have {MAX_TEXTURE_SIDE}"));
        }
        self.buffers.budget.take(size.pixels(), budget::TEXEL)?;
        Ok(encoded::pixels(decoder)?.into_rgba8())
    }
}
