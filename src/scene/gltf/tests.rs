use super::super::{Model, SceneError, VirtualScene};
use glam::Vec3;
use serde_json::{Value, json};
use std::path::Path;

/// A GLB file of `json` and `binary`.
fn glb(json: &Value, binary: &[u8]) -> Vec<u8> {
    let mut chunks = Vec::new();
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut binary = binary.to_vec();
    binary.resize(binary.len().next_multiple_of(4), 0);
    for (kind, data) in [(b"JSON", json), (b"BIN\0", binary)] {
        chunks.extend((data.len() as u32).to_le_bytes());
        chunks.extend(kind);
        chunks.extend(data);
    }
    let mut file = b"glTF".to_vec();
    file.extend(2u32.to_le_bytes());
    file.extend((12 + chunks.len() as u32).to_le_bytes());
    file.extend(chunks);
    file
}

/// Builds assets: attribute arrays go one after the other into the binary chunk.
struct Asset {
    json: Value,
    binary: Vec<u8>,
}

impl Asset {
    /// One node with one mesh of one primitive with these positions.
    fn new(positions: &[[f32; 3]]) -> Self {
        let json = json!({
            "asset": {"version": "2.0"},
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {}}]}],
            "accessors": [], "bufferViews": [], "buffers": [],
        });
        let mut asset = Self { json, binary: Vec::new() };
        let bytes: Vec<u8> = positions.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        let index = asset.accessor(5126, "VEC3", positions.len(), &bytes);
        asset.json["accessors"][index]["min"] = json!([0, 0, 0]);
        asset.json["accessors"][index]["max"] = json!([0, 0, 0]);
        asset.primitive()["attributes"]["POSITION"] = json!(index);
        asset
    }

    fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        let views = self.json["bufferViews"].as_array_mut().unwrap();
        let (offset, length) = (self.binary.len(), bytes.len());
        views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": length}));
        self.binary.extend(bytes);
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        views.len() - 1
    }

    fn accessor(&mut self, component: u32, kind: &str, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let accessors = self.json["accessors"].as_array_mut().unwrap();
        accessors.push(
            json!({"bufferView": view, "componentType": component, "count": count, "type": kind}),
        );
        accessors.len() - 1
    }

    fn attribute(&mut self, name: &str, component: u32, kind: &str, count: usize, bytes: &[u8]) {
        let index = self.accessor(component, kind, count, bytes);
        self.primitive()["attributes"][name] = json!(index);
    }

    fn indices(&mut self, indices: &[u16]) {
        let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
        let index = self.accessor(5123, "SCALAR", indices.len(), &bytes);
        self.primitive()["indices"] = json!(index);
    }

    fn bytes(&mut self) -> Vec<u8> {
        self.json["buffers"] = json!([{"byteLength": self.binary.len()}]);
        glb(&self.json, &self.binary)
    }

    fn load(&mut self) -> Result<Model, String> {
        super::read(Path::new("test.glb"), &self.bytes())
    }
}

const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

fn normal(model: &Model, triangle: usize) -> Vec3 {
    let [a, b, c] = model.triangles()[triangle].map(|i| model.vertices()[i as usize].position);
    (b - a).cross(c - a).normalize()
}

#[test]
fn lists_strips_and_fans_keep_their_winding() {
    let load = |mode: u32, indices: &[u16]| {
        let mut asset = Asset::new(&CORNERS);
        asset.indices(indices);
        asset.primitive()["mode"] = json!(mode);
        asset.load().unwrap()
    };
    let list = load(4, &[0, 1, 2, 0, 2, 3]);
    assert_eq!(list.triangles(), [[0, 1, 2], [0, 2, 3]]);
    for model in [list, load(5, &[0, 1, 3, 2]), load(6, &[0, 1, 2, 3])] {
        assert_eq!(model.triangles().len(), 2);
        assert!((0..2).all(|t| normal(&model, t) == Vec3::Z));
        assert_eq!(model.vertices()[0].normal, Vec3::ZERO, "flat where NORMAL is missing");
    }
    assert!(load(1, &[0, 1]).triangles().is_empty(), "lines are left out");
    let mut unindexed = Asset::new(&CORNERS[..3]);
    assert_eq!(unindexed.load().unwrap().triangles(), [[0, 1, 2]]);
}

#[test]
fn node_transforms_apply_from_the_root_down() {
    let mut asset = Asset::new(&CORNERS[..3]);
    let up: Vec<u8> = [0.0f32, 0.0, 1.0].repeat(3).iter().flat_map(|v| v.to_le_bytes()).collect();
    asset.attribute("NORMAL", 5126, "VEC3", 3, &up);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    asset.json["nodes"] = json!([
        {"children": [1], "translation": [10, 0, 0], "rotation": [half, 0, 0, half]},
        {"mesh": 0, "scale": [2, 3, -4]},
        {"mesh": 0},
    ]);
    let model = asset.load().unwrap();
    assert_eq!(model.triangles().len(), 1, "node 2 is in no scene");
    // scale, then a quarter turn about x (y to z), then the shift
    let p = |i: usize| model.vertices()[i].position;
    assert!((p(1) - Vec3::new(12.0, 0.0, 0.0)).length() < 1e-5);
    assert!((p(2) - Vec3::new(12.0, 0.0, 3.0)).length() < 1e-5);
    // +z is mirrored to -z and turned to +y; the winding follows
    assert!((model.vertices()[0].normal - Vec3::Y).length() < 1e-5);
    assert!((normal(&model, 0) - Vec3::Y).length() < 1e-5);

    asset.json["nodes"] = json!([{"children": [1]}, {"children": [0], "mesh": 0}]);
    assert!(asset.load().unwrap_err().contains("ancestor"));
    asset.json["nodes"] = json!([{"mesh": 0}]);
    asset.json["scenes"] = json!([{"nodes": [0]}, {"nodes": [0]}]);
    assert_eq!(asset.load().unwrap().triangles().len(), 1, "a node of two scenes is shown once");
}

#[test]
fn skins_are_shown_in_rest_pose() {
    let mut asset = Asset::new(&CORNERS[..3]);
    asset.attribute("JOINTS_0", 5121, "VEC4", 3, &[0, 1, 0, 0].repeat(3));
    let weights: Vec<u8> =
        [0.5f32, 0.5, 0.0, 0.0].repeat(3).iter().flat_map(|v| v.to_le_bytes()).collect();
    asset.attribute("WEIGHTS_0", 5126, "VEC4", 3, &weights);
    asset.json["nodes"] = json!([
        {"mesh": 0, "skin": 0, "translation": [99, 99, 99]},
        {"translation": [0, 2, 0]},
        {"translation": [0, 0, 4]},
    ]);
    asset.json["scenes"] = json!([{"nodes": [0, 1, 2]}]);
    asset.json["skins"] = json!([{"joints": [1, 2]}]);
    let model = asset.load().unwrap();
    assert_eq!(model.vertices()[1].position, Vec3::new(1.0, 1.0, 2.0));
    asset.json["skins"] = json!([{"joints": [1]}]);
    assert!(asset.load().unwrap_err().contains("joint 1"));
}

#[test]
fn sparse_and_normalised_accessors() {
    let mut asset = Asset::new(&CORNERS);
    asset.indices(&[0, 1, 2]);
    asset.attribute("COLOR_0", 5121, "VEC3", 4, &[255, 0, 51, 255, 0, 51, 255, 0, 51, 0, 0, 0]);
    asset.json["accessors"][2]["normalized"] = json!(true);
    let (index, value) = (asset.view(&[2]), asset.view(&7.0f32.to_le_bytes().repeat(3)));
    asset.json["accessors"][0]["sparse"] = json!({
        "count": 1,
        "indices": {"bufferView": index, "componentType": 5121},
        "values": {"bufferView": value},
    });
    let model = asset.load().unwrap();
    assert_eq!(model.vertices()[2].position, Vec3::splat(7.0));
    assert_eq!(model.vertices()[1].position, Vec3::X);
    let gap = glam::Vec4::from(model.colors()[0]) - glam::Vec4::new(1.0, 0.0, 0.2, 1.0);
    assert!(gap.length() < 1e-6, "{gap}");
    asset.json["accessors"][0]["sparse"]["count"] = json!(100);
    assert!(asset.load().unwrap_err().contains("do not fit"));
}

fn png(texels: &[[u8; 4]], width: u32) -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    let raw = texels.as_flattened().to_vec();
    image::RgbaImage::from_raw(width, texels.len() as u32 / width, raw)
        .unwrap()
        .write_to(&mut out, image::ImageFormat::Png)
        .unwrap();
    out.into_inner()
}

#[test]
fn base_colour_textures_and_their_transforms() {
    let mut asset = Asset::new(&CORNERS[..3]);
    let uvs: Vec<u8> =
        [0.25f32, 0.25, 0.75, 0.25, 0.25, 0.75].iter().flat_map(|v| v.to_le_bytes()).collect();
    asset.attribute("TEXCOORD_1", 5126, "VEC2", 3, &uvs);
    let picture = png(&[[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [9, 9, 9, 0]], 2);
    let view = asset.view(&picture);
    asset.json["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
    asset.json["samplers"] = json!([{"wrapS": 33071, "wrapT": 33648}]);
    asset.json["textures"] = json!([{"source": 0, "sampler": 0}]);
    asset.json["materials"] = json!([{
        "alphaMode": "MASK", "alphaCutoff": 0.25,
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 1, 1, 1], "baseColorTexture": {"index": 0, "texCoord": 1},
        },
    }]);
    asset.primitive()["material"] = json!(0);
    let model = asset.load().unwrap();
    let material = &model.parts()[0].material;
    assert_eq!(material.alpha_cutoff, Some(0.25));
    assert_eq!(material.base_color, [0.5, 1.0, 1.0, 1.0]);
    let colors = |model: &Model| -> Vec<[f32; 4]> {
        let texture = model.parts()[0].material.texture.clone().unwrap();
        let zero = glam::Vec2::ZERO;
        model.vertices().iter().map(|v| texture.sample(v.uv, zero, zero)).collect()
    };
    let [red, green, blue] = [[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]];
    assert_eq!(colors(&model), [red, green, blue], "the second row of texels is at larger v");

    asset.json["extensionsRequired"] = json!(["KHR_texture_transform"]);
    asset.json["extensionsUsed"] = json!(["KHR_texture_transform", "KHR_materials_sheen"]);
    let info = &mut asset.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"];
    info["extensions"] = json!({"KHR_texture_transform": {"offset": [1, 0], "scale": [-1, 1]}});
    let mirrored = colors(&asset.load().unwrap());
    assert_eq!([mirrored[0], mirrored[1]], [green, red]);

    asset.json["images"] = json!([{"uri": "../up.png"}]);
    assert!(asset.load().unwrap_err().contains("own folder"));
    asset.json["images"] = json!([{}]);
    assert!(asset.load().unwrap_err().contains("neither a buffer view nor a URI"));
    asset.json["images"] = json!([{"uri": "data:image/png;base64,AAAA"}]);
    assert!(asset.load().unwrap_err().contains("image 0"));
}

#[test]
fn external_files_are_found_beside_the_asset() {
    let folder = tempfile::tempdir().unwrap();
    let mut asset = Asset::new(&CORNERS[..3]);
    asset.bytes();
    asset.json["buffers"][0]["uri"] = json!("my%20data.bin");
    std::fs::write(folder.path().join("my data.bin"), &asset.binary).unwrap();
    let path = folder.path().join("a.gltf");
    std::fs::write(&path, asset.json.to_string()).unwrap();
    assert_eq!(Model::load(&path).unwrap().triangles().len(), 1);
    std::fs::write(folder.path().join("my data.bin"), &asset.binary[1..]).unwrap();
    let error = Model::load(&path).unwrap_err().to_string();
    assert!(error.contains("a.gltf") && error.contains("36 bytes expected, 35"), "{error}");
    std::fs::remove_file(folder.path().join("my data.bin")).unwrap();
    assert!(Model::load(&path).unwrap_err().to_string().contains("my data.bin"));
}

#[test]
fn broken_files_are_errors_that_name_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("broken.glb");
    let mut asset = Asset::new(&CORNERS);
    asset.indices(&[0, 1, 2]);
    let whole = asset.bytes();
    for end in (0..whole.len()).step_by(7) {
        std::fs::write(&path, &whole[..end]).unwrap();
        let error = Model::load(&path).unwrap_err().to_string();
        assert!(error.contains("broken.glb"), "{end}: {error}");
    }
    assert!(matches!(Model::load(&folder.path().join("none.glb")), Err(SceneError::Read { .. })));

    let wrong = |change: &dyn Fn(&mut Asset), part: &str| {
        let mut asset = Asset::new(&CORNERS);
        asset.indices(&[0, 1, 2]);
        change(&mut asset);
        let error = asset.load().unwrap_err();
        assert!(error.contains(part), "{error}");
    };
    wrong(&|a| a.indices(&[0, 1, 4]), "index 4 is out of range");
    wrong(&|a| a.primitive()["attributes"]["POSITION"] = json!(9), "accessor 9 of 2");
    wrong(&|a| a.primitive()["indices"] = json!(0), "type F32");
    wrong(&|a| a.json["accessors"][0]["count"] = json!(5), "do not fit");
    wrong(&|a| a.json["accessors"][0]["count"] = json!(1u64 << 60), "MiB");
    wrong(&|a| a.json["accessors"][0]["byteOffset"] = json!(u64::MAX), "do not fit");
    wrong(&|a| a.json["bufferViews"][0]["byteLength"] = json!(1 << 20), "past its buffer");
    wrong(&|a| a.json["bufferViews"][0]["byteStride"] = json!(4), "every 4 bytes");
    wrong(&|a| a.json["nodes"][0]["mesh"] = json!(3), "invalid");
    wrong(&|a| a.json["asset"]["version"] = json!("1.0"), "version 1.0");
    let draco = "KHR_draco_mesh_compression";
    wrong(&|a| a.json["extensionsRequired"] = json!([draco]), draco);
    wrong(&|a| a.attribute("NORMAL", 5126, "VEC3", 1, &[0; 12]), "1 NORMAL values for 4");
}

#[test]
fn small_files_cannot_ask_for_any_amount_of_memory() {
    let refused = |change: &dyn Fn(&mut Asset)| {
        let mut asset = Asset::new(&CORNERS);
        asset.indices(&[0, 1, 2]);
        change(&mut asset);
        let error = asset.load().unwrap_err();
        assert!(error.contains("MiB more than files of this length may"), "{error}");
    };
    // Zeros that no buffer holds, but for one element.
    for (accessor, component, size) in [(0, 5121, 12), (1, 5121, 2)] {
        refused(&|a| {
            let (index, value) = (a.view(&[0]), a.view(&vec![0; size]));
            let of = &mut a.json["accessors"][accessor];
            of["count"] = json!(1 << 28);
            of.as_object_mut().unwrap().remove("bufferView");
            of["sparse"] = json!({
                "count": 1,
                "indices": {"bufferView": index, "componentType": component},
                "values": {"bufferView": value},
            });
        });
    }
    // The same mesh of 20 000 corners, a thousand times.
    refused(&|a| {
        *a = Asset::new(&[[0.0; 3]; 20_000]);
        a.json["nodes"] = json!(vec![json!({"mesh": 0}); 1000]);
        a.json["scenes"] = json!([{"nodes": (0..1000).collect::<Vec<_>>()}]);
    });
    // One picture that compresses well, as 40 textures of 64 MiB.
    let picture = png(&vec![[0; 4]; 1 << 24], 1 << 12);
    refused(&|a| {
        let view = a.view(&picture);
        a.json["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
        a.json["textures"] = json!(vec![json!({"source": 0}); 40]);
        let material =
            |t: usize| json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": t}}});
        a.json["materials"] = json!((0..40).map(material).collect::<Vec<_>>());
        let primitive = a.primitive().clone();
        let with = |m: usize| {
            let mut primitive = primitive.clone();
            primitive["material"] = json!(m);
            primitive
        };
        a.json["meshes"][0]["primitives"] = json!((0..40).map(with).collect::<Vec<_>>());
    });
}

#[test]
fn any_damaged_byte_is_an_error_or_a_model_but_no_panic() {
    let mut asset = Asset::new(&CORNERS);
    asset.indices(&[0, 1, 2, 0, 2, 3]);
    let whole = asset.bytes();
    let mut rng = crate::math::random::Rng::new(&[17]);
    let mut loaded = 0;
    for _ in 0..3000 {
        let mut bytes = whole.clone();
        let at = rng.next_u32() as usize % bytes.len();
        bytes[at] = rng.next_u32() as u8;
        loaded += usize::from(super::read(Path::new("damaged.glb"), &bytes).is_ok());
    }
    assert!(loaded > 100 && loaded < 2900, "{loaded}");
}

#[test]
fn scene_files_name_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("o.glb"), Asset::new(&CORNERS[..3]).bytes()).unwrap();
    let path = folder.path().join("room.toml");
    let load = |text: &str| {
        std::fs::write(&path, text).unwrap();
        VirtualScene::load(&path)
    };
    let scene = load(
        "[[object]]\nfile = 'o.glb'\nat = [1, 2.5, 3]\nyaw_deg = 90\nscale = 2\n\
         [[object]]\nfile = 'o.glb'\non = [3, 4, 5]\nup = [0, 0, 2]\n",
    )
    .unwrap();
    assert_eq!((scene.objects.len(), scene.pending()), (2, 1));
    assert!(std::sync::Arc::ptr_eq(&scene.objects[0].model, &scene.objects[1].model));
    let placed = scene.objects[0].world_from_object().unwrap();
    assert_eq!((placed.scale, placed.translation), (2.0, Vec3::new(1.0, 2.5, 3.0)));
    assert!((placed.rotation * Vec3::Y - Vec3::Z).length() < 1e-6);
    assert_eq!(scene.bounds().count(), 1);
    assert!(load("").unwrap().objects.is_empty());

    let object = "[[object]]\nfile = 'o.glb'\n";
    for (text, parts) in [
        (format!("{object}at = [0, 0, 0]\non = [0, 0, 0]"), ["object 1", "`at`"]),
        (object.to_owned(), ["object 1", "`on`"]),
        (format!("{object}at = [0, 0]"), ["line 3", "at"]),
        (format!("{object}at = [0, 0, nan]"), ["object 1", "`at`"]),
        (format!("{object}at = [0, 0, -1e39]"), ["object 1", "`at`"]),
        (format!("{object}at = [0, 0, 0]\nscale = 0"), ["object 1", "`scale`"]),
        (format!("{object}at = [0, 0, 0]\nscale = inf"), ["object 1", "`scale`"]),
        (format!("{object}at = [0, 0, 0]\nyaw_deg = nan"), ["object 1", "`yaw_deg`"]),
        (format!("{object}at = [0, 0, 0]\nup = [0, 0, 0]"), ["object 1", "`up`"]),
        (format!("{object}on = [1, 2, 0.5]"), ["object 1", "`on`"]),
        (format!("{object}on = [-1, 2, 0]"), ["object 1", "`on`"]),
        (format!("{object}at = [0, 0, 0]\ncolour = 3"), ["line 4", "colour"]),
        ("[[object]]\nat = [0, 0, 0]".to_owned(), ["line 1", "file"]),
        ("[[object]]\nfile = 'no.glb'\nat = [0, 0, 0]".to_owned(), ["no.glb", "read"]),
        ("[[object".to_owned(), ["line 1", "room.toml"]),
    ] {
        let error = load(&text).unwrap_err().to_string();
        for part in parts {
            assert!(error.contains(part), "{text}\n{error}");
        }
        assert!(error.contains("room.toml") || error.contains("no.glb"), "{error}");
    }
}

#[test]
fn scene_files_that_nobody_chose_stay_in_their_folder() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("recording");
    std::fs::create_dir_all(folder.join("models")).unwrap();
    let model = Asset::new(&CORNERS[..3]).bytes();
    for place in ["recording/o.glb", "recording/models/o.glb", "o.glb"] {
        std::fs::write(root.path().join(place), &model).unwrap();
    }
    let path = folder.join("scene.toml");
    let named = |file: &str| {
        std::fs::write(&path, format!("[[object]]\nfile = '{file}'\nat = [0, 0, 0]\n")).unwrap();
    };
    for file in ["o.glb", "./o.glb", "models/o.glb"] {
        named(file);
        assert_eq!(VirtualScene::load_own(&path).unwrap().objects.len(), 1, "{file}");
    }
    let absolute = folder.join("o.glb").display().to_string();
    for file in ["../o.glb", "models/../../o.glb", &absolute] {
        named(file);
        let error = VirtualScene::load_own(&path).unwrap_err().to_string();
        assert!(error.contains("scene.toml") && error.contains("outside its folder"), "{error}");
        assert_eq!(VirtualScene::load(&path).unwrap().objects.len(), 1, "chosen: {file}");
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("../o.glb", folder.join("link.glb")).unwrap();
        named("link.glb");
        let error = VirtualScene::load_own(&path).unwrap_err().to_string();
        assert!(error.contains("link"), "{error}");
        std::fs::rename(&path, root.path().join("scene.toml")).unwrap();
        std::os::unix::fs::symlink("../scene.toml", &path).unwrap();
        assert!(VirtualScene::load_own(&path).unwrap_err().to_string().contains("link"));
    }
}

#[test]
fn real_assets_load() {
    let Some(folder) = crate::test_data::real_data("meshes") else { return };
    // triangles as the files' own index counts say
    for (file, triangles, textured) in [
        ("Duck", 4212, 1),
        ("DamagedHelmet", 15_452, 1),
        ("CesiumMan", 4672, 1),
        ("Fox", 576, 1),
        ("SheenChair", 35_528, 3),
    ] {
        let path = folder.join(format!("{file}.glb"));
        let data = std::fs::read(&path).unwrap();
        if (data.len() as u32) < u32::from_le_bytes(data[8..12].try_into().unwrap()) {
            println!("SKIPPED: {} is not complete", path.display());
            assert!(Model::load(&path).unwrap_err().to_string().contains("cut off"));
            continue;
        }
        let model = Model::load(&path).unwrap();
        assert_eq!(model.name(), file);
        let found = model.triangles().len() + model.dropped_triangles();
        assert_eq!(found, triangles, "{file}");
        assert!(model.dropped_triangles() * 100 < triangles, "{file}");
        let with_texture = model.parts().iter().filter(|p| p.material.texture.is_some()).count();
        assert_eq!(with_texture, textured, "{file}");
        assert!(model.bounds().radius > 0.1, "{file}: {:?}", model.bounds());
    }
}
