//! A sequence with truth: `virtual.json` says which object stands where and which frames have a
//! path-traced picture with it, `composite/` holds these pictures.

use crate::eval::light::LightTruth;
use crate::files;
use crate::image::encoded::{USUAL, decode_file};
use crate::image::{Image, Size};
use crate::scene::{Material, Model, PartData, Similarity, Vertex, VirtualObject, VirtualScene};
use crate::study::StudyError;
use glam::{Vec2, Vec3};
use serde::Deserialize;
use std::f32::consts::{PI, TAU};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Rings of the sphere that stands for `kind = "sphere"`: its outline is 0.1 % of the radius inside
/// the true one.
const SPHERE_RINGS: usize = 64;

/// The picture with the object, and the pixels that show it.
pub struct FrameTruth {
    pub frame: usize,
    /// Of the picture.
    pub path: PathBuf,
    pub picture: Image<[u8; 3]>,
    pub object: Image<bool>,
}

/// `virtual.json`, as far as it is needed here.
#[derive(Debug, Deserialize)]
struct VirtualFile {
    #[serde(flatten)]
    object: Object,
    name: String,
    frames: Vec<usize>,
    timestamps: Vec<String>,
}

#[derive(Debug, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
enum Object {
    Sphere {
        center: [f32; 3],
        radius: f32,
        albedo: [f32; 3],
    },
    /// Stands as `scene.toml` says.
    Mesh,
}

#[derive(Debug)]
pub struct TruthFolder {
    folder: PathBuf,
    file: VirtualFile,
}

impl TruthFolder {
    pub fn open(folder: &Path) -> Result<Self, StudyError> {
        let path = folder.join("virtual.json");
        let problem = |e: &dyn std::fmt::Display| StudyError::file(&path, e);
        let text = files::read_text(&path).map_err(|e| problem(&e))?;
        let file: VirtualFile = serde_json::from_str(&text).map_err(|e| problem(&e))?;
        let (frames, times) = (file.frames.len(), file.timestamps.len());
        if frames != times || frames == 0 {
            return Err(problem(&format!("{frames} frames and {times} timestamps")));
        }
        if let Object::Sphere { center, radius, albedo } = &file.object {
            let finite = center.iter().chain(albedo).all(|v| v.is_finite());
            if !(finite && *radius > 0.0 && radius.is_finite()) {
                return Err(problem(&"the sphere's values must be finite, its radius positive"));
            }
        }
        Ok(Self { folder: folder.to_owned(), file })
    }

    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Of the object.
    pub fn name(&self) -> &str {
        &self.file.name
    }

    /// Frames that have a picture with the object.
    pub fn frames(&self) -> &[usize] {
        &self.file.frames
    }

    /// The truth of a frame, where it has one.
    pub fn frame(&self, frame: usize) -> Result<Option<FrameTruth>, StudyError> {
        let Some(at) = self.file.frames.iter().position(|&f| f == frame) else { return Ok(None) };
        let stamp = &self.file.timestamps[at];
        let named = |ending: &str| {
            let path = files::inside(&self.folder.join("composite"), &format!("{stamp}{ending}"))
                .map_err(|e| StudyError::file(&self.folder.join("virtual.json"), e))?;
            match files::leads_out(&self.folder, &path) {
                true => Err(StudyError::file(&path, "a link leads out of the recording")),
                false => Ok(path),
            }
        };
        let jpeg = named(".jpg")?;
        let path = if jpeg.exists() { jpeg } else { named(".png")? };
        let picture = read(&path)?.into_rgb8();
        let size = Size::new(picture.width() as usize, picture.height() as usize);
        let pixels = picture.as_raw().as_chunks::<3>().0.to_vec();
        let mask_path = named(".mask.png")?;
        let mask = read(&mask_path)?.into_luma8();
        let mask_size = Size::new(mask.width() as usize, mask.height() as usize);
        if mask_size != size {
            let problem = format!("{mask_size} pixels, and the picture it belongs to has {size}");
            return Err(StudyError::file(&mask_path, problem));
        }
        Ok(Some(FrameTruth {
            frame,
            path,
            picture: Image::from_vec(size, pixels),
            object: Image::from_vec(size, mask.as_raw().iter().map(|&v| v > 127).collect()),
        }))
    }

    /// The object to compose, where the truth has it.
    pub fn scene(&self) -> Result<VirtualScene, StudyError> {
        match self.file.object {
            Object::Sphere { center, radius, albedo } => {
                let pose = Similarity { translation: center.into(), ..Similarity::IDENTITY };
                let model = Arc::new(sphere(&self.file.name, radius, albedo));
                Ok(VirtualScene::from_objects([VirtualObject::placed(model, pose)]))
            }
            Object::Mesh => {
                let path = self.folder.join("scene.toml");
                VirtualScene::load_own(&path).map_err(|e| StudyError::file(&path, e))
            }
        }
    }

    pub fn light(&self) -> Result<LightTruth, StudyError> {
        Ok(LightTruth::read(&self.folder.join("light.json"))?)
    }
}

fn read(path: &Path) -> Result<image::DynamicImage, StudyError> {
    decode_file(path, USUAL).map_err(|e| StudyError::file(path, e))
}

/// A sphere around the origin with one linear albedo.
fn sphere(name: &str, radius: f32, albedo: [f32; 3]) -> Model {
    let (rings, around) = (SPHERE_RINGS, 2 * SPHERE_RINGS);
    let corner = |i: usize| {
        let (ring, segment) = (i / (around + 1), i % (around + 1));
        let (sin, cos) = match ring {
            ring if ring == rings => (0.0, -1.0), // the pole is one point
            ring => (PI * ring as f32 / rings as f32).sin_cos(),
        };
        let (y, x) = (TAU * segment as f32 / around as f32).sin_cos();
        let normal = Vec3::new(sin * x, cos, -sin * y);
        Vertex { position: radius * normal, normal, uv: Vec2::ZERO }
    };
    let vertices = (0..(rings + 1) * (around + 1)).map(corner).collect();
    let cells = (0..rings).flat_map(|r| (0..around).map(move |s| (r, s)));
    let triangles = cells.flat_map(|(ring, segment)| {
        let above = (ring * (around + 1) + segment) as u32;
        let below = above + around as u32 + 1;
        [[above, below, above + 1], [above + 1, below, below + 1]]
    });
    let [r, g, b] = albedo;
    let material = Material { base_color: [r, g, b, 1.0], ..Material::default() };
    let part =
        PartData { vertices, triangles: triangles.collect(), material, ..PartData::default() };
    Model::new(name, vec![part]).expect("the sphere's triangles name its own corners")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sphere_is_round_and_faces_outwards() {
        let model = sphere("ball", 0.07, [0.6; 3]);
        // two triangles of each cell but those at the poles, which have one
        assert_eq!(model.triangles().len(), 2 * 128 * 63);
        for triangle in model.triangles() {
            let [a, b, c] = triangle.map(|i| model.vertices()[i as usize].position);
            let normal = (b - a).cross(c - a).normalize();
            let middle = (a + b + c) / 3.0;
            assert!(normal.dot(middle.normalize()) > 0.99);
            assert!(middle.length() > 0.999 * 0.07, "{}", middle.length());
        }
    }

    fn open(text: &str) -> Result<TruthFolder, StudyError> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("virtual.json"), text).unwrap();
        TruthFolder::open(folder.path())
    }

    #[test]
    fn mistakes_name_the_file() {
        let rest = r#""name":"a","frames":[3],"timestamps":["1.0"]"#;
        for (text, expected) in [
            ("{", "EOF"),
            (r#"{"kind":"mesh","name":"a","frames":[3],"timestamps":[]}"#, "1 frames and 0"),
            (&format!(r#"{{"kind":"torus",{rest}}}"#), "torus"),
            (&format!(r#"{{"kind":"sphere",{rest}}}"#), "center"),
            (
                &format!(
                    r#"{{"kind":"sphere","center":[0,0,0],"radius":0,"albedo":[0,0,0],{rest}}}"#
                ),
                "radius",
            ),
        ] {
            let message = open(text).unwrap_err().to_string();
            assert!(message.contains("virtual.json: ") && message.contains(expected), "{message}");
        }
        let folder = open(&format!(r#"{{"kind":"mesh",{rest}}}"#)).unwrap();
        assert!(folder.frame(2).unwrap().is_none());
        let message = folder.frame(3).err().unwrap().to_string();
        assert!(message.contains("composite/1.0.png"), "{message}");
        assert!(folder.scene().unwrap_err().to_string().contains("scene.toml"));
        for stamp in ["../1.0", "/1.0", "a/../../1.0"] {
            let away =
                format!(r#"{{"kind":"mesh","name":"a","frames":[3],"timestamps":["{stamp}"]}}"#);
            let message = open(&away).unwrap().frame(3).err().unwrap().to_string();
            assert!(message.contains("virtual.json") && message.contains("outside"), "{message}");
        }
        assert!(TruthFolder::open(Path::new("/nowhere")).unwrap_err().to_string().contains("/now"));
    }
}
