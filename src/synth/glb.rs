//! Writes a textured mesh as binary glTF 2.0: one header, one JSON chunk, one binary chunk.

use super::mesh::MeshData;
use crate::capture::writer::ColorFormat;
use crate::image::Image;
use glam::Vec3A;
use image::ImageResult;
use serde_json::{Value, json};

/// `mesh` in glTF axes (+y up, metres) with an sRGB base colour picture.
pub fn encode(name: &str, mesh: &MeshData, texture: &Image<[u8; 3]>) -> ImageResult<Vec<u8>> {
    let mut binary = Binary::default();
    let flat = |vectors: &[Vec3A]| vectors.iter().flat_map(|v| v.to_array()).collect::<Vec<f32>>();
    let uvs: Vec<f32> = mesh.uvs.iter().flat_map(|v| v.to_array()).collect();
    let views = [
        binary.add(bytes_f32(&flat(&mesh.positions)), Some(ARRAY_BUFFER)),
        binary.add(bytes_f32(&flat(&mesh.normals)), Some(ARRAY_BUFFER)),
        binary.add(bytes_f32(&uvs), Some(ARRAY_BUFFER)),
        binary.add(
            mesh.triangles.iter().flatten().flat_map(|i| i.to_le_bytes()).collect(),
            Some(ELEMENT_ARRAY_BUFFER),
        ),
        binary.add(ColorFormat::Png.encode(texture)?, None),
    ];
    let (min, max) = mesh
        .positions
        .iter()
        .fold((Vec3A::INFINITY, Vec3A::NEG_INFINITY), |(min, max), &p| (min.min(p), max.max(p)));
    let corners = mesh.positions.len();
    let document = json!({
        "asset": { "version": "2.0", "generator": "kinlight" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": name, "mesh": 0 }],
        "meshes": [{ "name": name, "primitives": [{
            "attributes": { "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2 },
            "indices": 3,
            "material": 0,
        }]}],
        "materials": [{ "name": name, "pbrMetallicRoughness": {
            "baseColorTexture": { "index": 0 },
            "metallicFactor": 0.0,
            "roughnessFactor": 0.5,
        }}],
        "textures": [{ "source": 0, "sampler": 0 }],
        "samplers": [{ "magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497 }],
        "images": [{ "bufferView": views[4], "mimeType": "image/png" }],
        "accessors": [
            { "bufferView": views[0], "componentType": FLOAT, "count": corners, "type": "VEC3",
              "min": min.to_array(), "max": max.to_array() },
            { "bufferView": views[1], "componentType": FLOAT, "count": corners, "type": "VEC3" },
            { "bufferView": views[2], "componentType": FLOAT, "count": corners, "type": "VEC2" },
            { "bufferView": views[3], "componentType": UNSIGNED_INT,
              "count": mesh.triangles.len() * 3, "type": "SCALAR" },
        ],
        "bufferViews": binary.views,
        "buffers": [{ "byteLength": binary.bytes.len() }],
    });
    Ok(container(document.to_string().into_bytes(), binary.bytes))
}

const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;

/// The binary chunk and the views into it; every view begins at a multiple of 4.
#[derive(Default)]
struct Binary {
    bytes: Vec<u8>,
    views: Vec<Value>,
}

impl Binary {
    fn add(&mut self, data: Vec<u8>, target: Option<u32>) -> usize {
        let mut view =
            json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": data.len() });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bytes.extend(data);
        pad(&mut self.bytes, 0);
        self.views.push(view);
        self.views.len() - 1
    }
}

fn bytes_f32(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn pad(bytes: &mut Vec<u8>, with: u8) {
    bytes.resize(bytes.len().next_multiple_of(4), with);
}

fn container(mut json: Vec<u8>, binary: Vec<u8>) -> Vec<u8> {
    pad(&mut json, b' ');
    let total = 12 + 8 + json.len() + 8 + binary.len();
    let mut out = Vec::with_capacity(total);
    out.extend(b"glTF");
    out.extend(2u32.to_le_bytes());
    out.extend((total as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &binary)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::virtual_object::figure;

    #[test]
    fn another_reader_gets_the_same_mesh_and_texture() {
        let (mesh, texture) = figure();
        let bytes = encode("figure", &mesh, &texture).expect("an encodable picture");
        // import_slice validates the document too
        let (document, buffers, images) = gltf::import_slice(&bytes).expect("valid glTF");
        let primitive =
            document.meshes().next().and_then(|m| m.primitives().next()).expect("one primitive");
        let reader = primitive.reader(|b| Some(&buffers[b.index()]));
        let positions: Vec<[f32; 3]> = reader.read_positions().expect("positions").collect();
        let normals: Vec<[f32; 3]> = reader.read_normals().expect("normals").collect();
        let indices: Vec<u32> = reader.read_indices().expect("indices").into_u32().collect();
        let uvs: Vec<[f32; 2]> =
            reader.read_tex_coords(0).expect("texture coordinates").into_f32().collect();
        assert!(positions.iter().zip(&mesh.positions).all(|(a, b)| *a == b.to_array()));
        assert!(normals.iter().zip(&mesh.normals).all(|(a, b)| *a == b.to_array()));
        assert!(uvs.iter().zip(&mesh.uvs).all(|(a, b)| *a == b.to_array()));
        assert_eq!(indices, mesh.triangles.as_flattened());
        assert_eq!(positions.len(), mesh.positions.len());
        assert_eq!((images[0].width, images[0].height), (512, 512));
        assert_eq!(images[0].pixels, texture.as_slice().as_flattened());
        let base = primitive.material().pbr_metallic_roughness();
        assert!(base.base_color_texture().is_some() && base.metallic_factor() == 0.0);
    }
}
