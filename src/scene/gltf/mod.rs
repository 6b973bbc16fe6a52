//! Reads the surfaces of glTF 2.0 and GLB files: geometry, node transforms, base colour.
//!
//! Left out: lights, cameras, animation (skins are shown in rest pose), morph targets, and all of
//! the material but its base colour.

mod accessor;
mod budget;
mod container;
mod materials;
mod primitive;
#[cfg(test)]
mod tests;

use super::SceneError;
use super::error::read_limited;
use super::model::Model;
use accessor::Buffers;
use budget::Budget;
use glam::DMat4;
use gltf::Document;
use materials::Materials;
use serde_json::Value;
use std::path::Path;

/// Extensions that a file may require: understood, or without meaning for base colour.
const KNOWN_EXTENSIONS: [&str; 3] =
    ["KHR_texture_transform", "KHR_mesh_quantization", "KHR_lights_punctual"];

/// A parsed file, and where it lies.
struct Source<'a> {
    path: &'a Path,
    folder: &'a Path,
    document: &'a Document,
    /// The same JSON, for extensions that the parser does not keep.
    raw: &'a Value,
}

impl Source<'_> {
    fn uv_transform(&self, material: usize) -> Option<&Value> {
        self.raw
            .get("materials")?
            .get(material)?
            .pointer("/pbrMetallicRoughness/baseColorTexture/extensions/KHR_texture_transform")
    }
}

impl Model {
    /// Reads a `.gltf` or `.glb` file. Everything it refers to must lie in its own folder.
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        let data = read_limited(path, Budget::default().file_limit())?;
        Self::from_bytes(path, &data)
    }

    /// As [`Self::load`], of a file that was read already.
    pub(crate) fn from_bytes(path: &Path, data: &[u8]) -> Result<Self, SceneError> {
        read(path, data).map_err(|what| SceneError::Model { path: path.to_owned(), what })
    }
}

fn read(path: &Path, data: &[u8]) -> Result<Model, String> {
    let container = container::split(data)?;
    let raw: Value = serde_json::from_slice(container.json)
        .map_err(|e| format!("not a glTF file, or a damaged one: {e}"))?;
    let document = parse(path, container.json)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let source = Source { path, folder, document: &document, raw: &raw };
    let buffers = read_buffers(&source, data.len(), container.binary)?;
    let world_from_node = node_transforms(&document)?;
    let mut materials = Materials::new(&source, &buffers);
    let mut reader = primitive::Reader::new(&buffers, &world_from_node);
    let mut parts = Vec::new();
    for node in document.nodes().filter(|node| world_from_node[node.index()].is_some()) {
        let Some(mesh) = node.mesh() else { continue };
        for primitive in mesh.primitives() {
            let place =
                |what| format!("mesh {} primitive {}: {what}", mesh.index(), primitive.index());
            let material = materials.get(&primitive.material()).map_err(place)?;
            parts.extend(reader.read(&node, &primitive, material).map_err(place)?);
        }
    }
    let name = path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    let model = Model::new(name, parts)?;
    report(&source, &model, reader.skipped_modes);
    Ok(model)
}

/// Parses and validates; afterwards all indices between JSON objects are good.
fn parse(path: &Path, json: &[u8]) -> Result<Document, String> {
    let mut root: gltf::json::Root = gltf::json::deserialize::from_slice(json)
        .map_err(|e| format!("not a glTF file, or a damaged one: {e}"))?;
    if !root.asset.version.starts_with("2.") {
        return Err(format!("glTF version {}; only 2.x is read", root.asset.version));
    }
    let known = |name: &String| {
        KNOWN_EXTENSIONS.contains(&name.as_str()) || name.starts_with("KHR_materials_")
    };
    if let Some(name) = root.extensions_required.iter().find(|name| !known(name)) {
        return Err(format!("requires the extension {name}, which is not supported"));
    }
    let ignored: Vec<_> =
        root.extensions_used.iter().filter(|n| n.starts_with("KHR_materials_")).cloned().collect();
    if !ignored.is_empty() {
        log::info!("{}: only base colour is used, not {}", path.display(), ignored.join(", "));
    }
    root.extensions_required.clear();
    // The validator looks up POSITION accessors before it checks their indices.
    let accessors = root.accessors.len();
    for (mesh, primitive) in root.meshes.iter().flat_map(|m| &m.primitives).enumerate() {
        if let Some(bad) = primitive.attributes.values().find(|i| i.value() >= accessors) {
            let bad = bad.value();
            return Err(format!("primitive {mesh}: accessor {bad} of {accessors} is out of range"));
        }
    }
    Document::from_json(root).map_err(|e| format!("invalid glTF: {e}"))
}

fn read_buffers(
    source: &Source,
    length: usize,
    mut binary: Option<&[u8]>,
) -> Result<Buffers, String> {
    let budget = Budget::default();
    budget.add_file(length);
    let mut all = Vec::new();
    for buffer in source.document.buffers() {
        let problem = |what| format!("buffer {}: {what}", buffer.index());
        let data = match buffer.source() {
            gltf::buffer::Source::Bin => binary
                .take()
                .ok_or("has no URI, and there is no binary chunk")
                .map(<[u8]>::to_vec)
                .map_err(|e| problem(e.to_owned()))?,
            gltf::buffer::Source::Uri(uri) => {
                container::read_uri(uri, source.folder, &budget).map_err(problem)?
            }
        };
        if data.len() < buffer.length() {
            let (expected, got) = (buffer.length(), data.len());
            return Err(problem(format!("{expected} bytes expected, {got} found")));
        }
        all.push(data);
    }
    Ok(Buffers { bytes: all, budget })
}

/// Transform of every node that a scene shows. A file without scenes shows its root nodes.
fn node_transforms(document: &Document) -> Result<Vec<Option<DMat4>>, String> {
    let mut world_from_node = vec![None; document.nodes().len()];
    let mut is_child = vec![false; document.nodes().len()];
    document.nodes().flat_map(|n| n.children()).for_each(|c| is_child[c.index()] = true);
    let mut open: Vec<_> = match document.scenes().len() {
        0 => document
            .nodes()
            .filter(|n| !is_child[n.index()])
            .map(|n| (n, DMat4::IDENTITY))
            .collect(),
        // Scenes may share root nodes: each is shown once.
        _ => document.scenes().flat_map(|s| s.nodes()).map(|n| (n, DMat4::IDENTITY)).collect(),
    };
    open.sort_by_key(|(node, _)| node.index());
    open.dedup_by_key(|(node, _)| node.index());
    while let Some((node, parent)) = open.pop() {
        let local = node.transform().matrix();
        let world = parent * glam::Mat4::from_cols_array_2d(&local).as_dmat4();
        if world_from_node[node.index()].replace(world).is_some() {
            return Err(format!("node {} has two parents, or is its own ancestor", node.index()));
        }
        open.extend(node.children().map(|child| (child, world)));
    }
    Ok(world_from_node)
}

fn report(source: &Source, model: &Model, skipped_modes: usize) {
    let file = source.path.display();
    if model.dropped_triangles() > 0 {
        let n = model.dropped_triangles();
        log::warn!("{file}: {n} triangles without area or with broken coordinates were left out");
    }
    if skipped_modes > 0 {
        log::warn!("{file}: {skipped_modes} primitives of points or lines were left out");
    }
    if model.triangles().is_empty() {
        log::warn!("{file}: has no triangles, nothing will be seen of it");
    }
}
