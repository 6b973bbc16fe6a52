//! Virtual objects and where they stand.

use super::SceneError;
use super::anchor::SurfaceAnchor;
use super::file::{ObjectSpec, SceneFile, Stand};
use super::model::{BoundingSphere, Model};
use crate::files;
use crate::geometry::GBuffer;
use glam::{Affine3A, Quat, Vec3};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Rotation, uniform scale and translation from a model's axes (+y up) to the world's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    pub rotation: Quat,
    pub scale: f32,
    /// Metres.
    pub translation: Vec3,
}

impl Similarity {
    pub const IDENTITY: Self =
        Self { rotation: Quat::IDENTITY, scale: 1.0, translation: Vec3::ZERO };

    /// Stands a model with +y along the unit vector `up`, turned about it by `yaw_rad`. Without yaw the
    /// turn from +y to `up` is the shortest one; where `up` is -y it is half a turn about x.
    pub fn standing(position: Vec3, up: Vec3, yaw_rad: f32, scale: f32) -> Self {
        let upright = if up.y < -1.0 + 1e-6 {
            Quat::from_rotation_x(std::f32::consts::PI)
        } else {
            Quat::from_rotation_arc(Vec3::Y, up)
        };
        let rotation = (upright * Quat::from_rotation_y(yaw_rad)).normalize();
        Self { rotation, scale, translation: position }
    }

    pub fn affine(&self) -> Affine3A {
        Affine3A::from_scale_rotation_translation(
            Vec3::splat(self.scale),
            self.rotation,
            self.translation,
        )
    }
}

#[derive(Clone, Debug)]
pub enum Placement {
    /// `world_from_object`.
    Placed(Similarity),
    /// Waits for [`VirtualScene::resolve`]; not drawn until then.
    Pending(SurfaceAnchor),
}

/// One instance of a model.
#[derive(Clone, Debug)]
pub struct VirtualObject {
    pub model: Arc<Model>,
    pub placement: Placement,
}

impl VirtualObject {
    pub fn placed(model: Arc<Model>, world_from_object: Similarity) -> Self {
        Self { model, placement: Placement::Placed(world_from_object) }
    }

    pub fn world_from_object(&self) -> Option<Similarity> {
        match self.placement {
            Placement::Placed(similarity) => Some(similarity),
            Placement::Pending(_) => None,
        }
    }

    /// In world axes; `None` while the object has no place, or nothing to show.
    pub fn bounds(&self) -> Option<BoundingSphere> {
        let world_from_object = self.world_from_object()?;
        let bounds = self.model.bounds();
        (!self.model.triangles().is_empty()).then(|| BoundingSphere {
            centre: world_from_object.affine().transform_point3(bounds.centre),
            radius: bounds.radius * world_from_object.scale,
        })
    }
}

/// All virtual objects of a run. Plain data: objects may be moved, added and removed between frames.
#[derive(Clone, Debug, Default)]
pub struct VirtualScene {
    pub objects: Vec<VirtualObject>,
}

impl VirtualScene {
    pub fn from_objects(objects: impl Into<Vec<VirtualObject>>) -> Self {
        Self { objects: objects.into() }
    }

    /// Reads a scene file and the models it names, wherever they are.
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        Self::from_file(&SceneFile::load(path)?, path)
    }

    /// As [`Self::load`], of a file that came with a recording and was not chosen: its models must lie in
    /// its own folder, and so must the file where it is a link.
    pub fn load_own(path: &Path) -> Result<Self, SceneError> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let elsewhere =
            |what: &str| SceneError::Elsewhere { path: path.to_owned(), what: what.into() };
        if files::leads_out(folder, path) {
            return Err(elsewhere("a link leads out of the folder"));
        }
        let file = SceneFile::load(path)?;
        for spec in &file.object {
            let name = spec.file.to_str().ok_or_else(|| elsewhere("a name is not UTF-8"))?;
            let model = files::inside(folder, name).map_err(|problem| elsewhere(&problem))?;
            if files::leads_out(folder, &model) {
                return Err(elsewhere(&format!(
                    "\"{name}\" is a link that leads out of the folder"
                )));
            }
        }
        Self::from_file(&file, path)
    }

    /// Checks the values of `file`, whose relative paths start at the folder of `path`, and loads its
    /// models. Objects of the same file share one model.
    pub fn from_file(file: &SceneFile, path: &Path) -> Result<Self, SceneError> {
        let stands: Vec<Stand> = file
            .object
            .iter()
            .enumerate()
            .map(|(i, spec)| {
                spec.stand().map_err(|(key, what)| bad_value(path, i, spec, key, what))
            })
            .collect::<Result<_, _>>()?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut models: HashMap<PathBuf, Arc<Model>> = HashMap::new();
        let mut objects = Vec::with_capacity(stands.len());
        for (spec, stand) in file.object.iter().zip(stands) {
            let file = folder.join(&spec.file);
            let model = match models.get(&file) {
                Some(model) => model.clone(),
                None => {
                    let model = Arc::new(Model::load(&file)?);
                    models.insert(file, model.clone());
                    model
                }
            };
            objects.push(VirtualObject { model, placement: stand.placement() });
        }
        Ok(Self { objects })
    }

    /// Moves all objects that have a place, metres.
    pub fn translate(&mut self, offset: Vec3) {
        for object in &mut self.objects {
            if let Placement::Placed(similarity) = &mut object.placement {
                similarity.translation += offset;
            }
        }
    }

    /// Stands waiting objects on the surface seen at their pixel, once `frame` has come. Returns how
    /// many found their place; the others are tried again with the next frame.
    pub fn resolve(&mut self, frame: usize, surface: &GBuffer) -> usize {
        let mut resolved = 0;
        for object in &mut self.objects {
            let Placement::Pending(anchor) = &mut object.placement else { continue };
            if let Some(similarity) = anchor.resolve(frame, surface, object.model.name()) {
                object.placement = Placement::Placed(similarity);
                resolved += 1;
            }
        }
        resolved
    }

    /// Objects that still wait for a surface to stand on.
    pub fn pending(&self) -> usize {
        self.objects.iter().filter(|o| matches!(o.placement, Placement::Pending(_))).count()
    }

    /// Whether an object looks for its place in this frame.
    #[cfg(feature = "gpu")]
    pub(crate) fn waits_at(&self, frame: usize) -> bool {
        let mut objects = self.objects.iter();
        objects.any(|o| matches!(&o.placement, Placement::Pending(anchor) if anchor.frame <= frame))
    }

    /// World-space spheres around the objects that have a place.
    pub fn bounds(&self) -> impl Iterator<Item = BoundingSphere> {
        self.objects.iter().filter_map(VirtualObject::bounds)
    }
}

fn bad_value(
    path: &Path,
    index: usize,
    spec: &ObjectSpec,
    key: &'static str,
    what: String,
) -> SceneError {
    let file = spec.file.display().to_string();
    SceneError::Object { path: path.to_owned(), index: index + 1, file, key, what }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_stand_upright_for_any_up() {
        let ups = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z];
        let tilted = [Vec3::new(0.1, -1.0, 1e-4), Vec3::new(1e-5, -1.0, 0.0), Vec3::ONE];
        for up in ups.into_iter().chain(tilted).map(Vec3::normalize) {
            for yaw in [0.0, 0.7] {
                let pose = Similarity::standing(Vec3::ONE, up, yaw, 2.0);
                let top = pose.affine().transform_point3(Vec3::Y);
                // half-angle formulas near -y lose half of f32's digits: sqrt(2^-23) = 3e-4
                assert!((top - (Vec3::ONE + 2.0 * up)).length() < 2e-3, "{up} {top}");
                assert_eq!(pose.affine().transform_point3(Vec3::ZERO), Vec3::ONE);
            }
        }
        // y-up to z-up without yaw is (x, -z, y)
        let front = Similarity::standing(Vec3::ZERO, Vec3::Z, 0.0, 1.0).rotation * Vec3::Z;
        assert!((front + Vec3::Y).length() < 1e-6);
        // positive yaw is counter-clockwise seen from above
        let quarter = Similarity::standing(Vec3::ZERO, Vec3::Z, std::f32::consts::FRAC_PI_2, 1.0);
        assert!((quarter.rotation * Vec3::X - Vec3::Y).length() < 1e-6);
    }

    #[test]
    fn bounds_follow_the_placement() {
        let vertices = [Vec3::ZERO, Vec3::X, Vec3::Y]
            .map(|position| super::super::Vertex { position, ..Default::default() })
            .to_vec();
        let part =
            super::super::PartData { vertices, triangles: vec![[0, 1, 2]], ..Default::default() };
        let model = Arc::new(Model::new("t", vec![part]).unwrap());
        let pose = Similarity::standing(Vec3::new(1.0, 2.0, 3.0), Vec3::Z, 0.3, 4.0);
        let object = VirtualObject::placed(model.clone(), pose);
        let sphere = object.bounds().unwrap();
        for v in model.vertices() {
            let p = pose.affine().transform_point3(v.position);
            assert!(p.distance(sphere.centre) <= sphere.radius * 1.000_01);
        }
        assert!((sphere.radius - 4.0 * 0.5f32.sqrt()).abs() < 1e-5);
        let empty = VirtualObject::placed(Arc::new(Model::default()), pose);
        assert!(empty.bounds().is_none());
    }
}
