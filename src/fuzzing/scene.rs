//! Virtual objects: scene files and glTF.

use super::{Scratch, accepted};
use crate::compositing::VirtualLayer;
use crate::geometry::GBuffer;
use crate::math::{Pinhole, Pose, View};
use crate::scene::{Model, Rasteriser, Similarity, VirtualObject, VirtualScene};
use glam::{Vec2, Vec3};
use std::path::PathBuf;
use std::sync::Arc;

/// A GLB of one triangle, for scene files to name.
pub(super) fn triangle() -> Vec<u8> {
    let corners = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let json = r#"{"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],
"bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36}]}"#;
    glb(json, &corners.map(f32::to_le_bytes).concat())
}

/// A GLB file of JSON and a binary chunk.
pub(super) fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut chunks = Vec::new();
    for (kind, data, filler) in [(b"JSON", json.as_bytes(), b' '), (b"BIN\0", binary, 0)] {
        let length = data.len().next_multiple_of(4);
        chunks.extend((length as u32).to_le_bytes());
        chunks.extend(kind);
        chunks.extend(data);
        chunks.resize(chunks.len() + length - data.len(), filler);
    }
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((12 + chunks.len() as u32).to_le_bytes());
    file.extend(chunks);
    file
}

/// A scene file that came with a recording.
pub fn scene(data: &[u8], scratch: &Scratch) -> bool {
    let folder = prepared(scratch);
    let path = folder.join("scene.toml");
    scratch.write(&path, data);
    accepted(VirtualScene::load_own(&path).map(|scene| {
        for object in &scene.objects {
            assert_ne!(object.model.name(), "secret", "it lies outside");
            if let Some(Similarity { rotation, scale, translation }) = object.world_from_object() {
                assert!(rotation.is_normalized() && scale.is_finite() && translation.is_finite());
            }
        }
    }))
}

/// A folder with a model, a file beside it that nothing in the folder may reach, and a link there.
fn prepared(scratch: &Scratch) -> PathBuf {
    let folder = scratch.folder("scene/own");
    if !folder.join("o.glb").exists() {
        scratch.write(&folder.join("o.glb"), &triangle());
        scratch.write(&folder.join("data.bin"), &[0; 256]);
        scratch.write(&scratch.root().join("scene/secret.glb"), &triangle());
        #[cfg(unix)]
        std::os::unix::fs::symlink("../secret.glb", folder.join("link.glb")).expect("a link");
    }
    folder
}

/// A glTF or GLB file with what it refers to; what is read of it is drawn.
pub fn gltf(data: &[u8], scratch: &Scratch) -> bool {
    let folder = prepared(scratch);
    let Ok(model) = Model::from_bytes(&folder.join("model.glb"), data) else { return false };
    for triangle in model.triangles() {
        for &i in triangle {
            assert!(model.vertices()[i as usize].position.is_finite());
        }
    }
    for part in model.parts() {
        assert!(part.triangles.end <= model.triangles().len());
        if let Some(texture) = &part.material.texture {
            let uv = model.vertices()[0].uv;
            let color = texture.sample(uv, Vec2::new(0.1, 0.0), Vec2::new(0.0, 0.1));
            assert!(color.iter().all(|c| (0.0..=1.001).contains(c)), "{color:?}");
        }
    }
    draw(model);
    true
}

/// From a little way off, in a small picture.
fn draw(model: Model) {
    if model.triangles().len() > 1000 {
        return;
    }
    let camera = Pinhole { width: 24, height: 16, fx: 20.0, fy: 20.0, cx: 11.5, cy: 7.5 };
    let bounds = model.bounds();
    let placement = Similarity {
        scale: 1.0 / bounds.radius.max(1e-3),
        translation: Vec3::new(0.0, 0.0, 2.0) - bounds.centre / bounds.radius.max(1e-3),
        ..Similarity::IDENTITY
    };
    let scene = VirtualScene::from_objects([VirtualObject::placed(Arc::new(model), placement)]);
    let real = GBuffer::empty(View::perspective(camera, Pose::identity()));
    let (mut merged, mut layer) = (real.clone(), VirtualLayer::default());
    let report = Rasteriser::default().draw(&scene, &real, &mut merged, &mut layer);
    assert!(report.pixels <= camera.width * camera.height);
}
