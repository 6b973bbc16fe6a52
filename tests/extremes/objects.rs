//! Virtual objects of all sizes in all places, and files that hold none.

use crate::frames::{SIZE, at_corner, in_front, seen};
use crate::models::{boxed, placed, standing, triangles};
use crate::runs::{run, settings};
use crate::table::{Device, Found, On, Outcome, Table};
use glam::{Quat, Vec2, Vec3};
use kinlight::scene::analytic::AnalyticScene;
use kinlight::scene::{
    Material, Model, PartData, Placement, Similarity, SurfaceAnchor, Vertex, VirtualObject,
    VirtualScene,
};
use serde_json::json;
use std::sync::Arc;

/// What is seen of an object in the picture.
#[derive(Clone, Copy, PartialEq)]
enum Seen {
    Yes,
    /// The picture is the camera's.
    No,
    /// Beyond what squares of f32 hold, inside out, or cut by the nearest plane: either, without NaN.
    Maybe,
}

/// By each method, with a bounce and without.
const METHODS: [&[(&str, &str)]; 3] = [
    &[],
    &[
        ("bounce.enabled", "false"),
        ("transfer.subsampling", "1"),
        ("compositing.compositor", "difference"),
    ],
    &[("bounce.enabled", "false"), ("transfer.method", "ray-traced")],
];

fn shown(on: Device<'_>, scene: &VirtualScene, seen_there: Seen) -> Outcome {
    let frames = [0, 1].map(|index| seen(&AnalyticScene::corner(), SIZE, at_corner(), index));
    let mut worst: Option<Found> = None;
    for changes in METHODS {
        let mut run = run(on, &settings(changes)?, scene.clone(), &frames)?;
        let changed = run.backend().composed().as_slice() != frames[1].color.as_slice();
        let expected = match seen_there {
            Seen::Yes => changed,
            Seen::No => !changed,
            Seen::Maybe => true,
        };
        run.broken.rule(expected, || format!("{changes:?}: the picture changed: {changed}"));
        run.broken.rule(run.outcomes[1].composed, || "it is not composed".to_owned());
        let found = run.finish()?;
        worst = Some(worst.map_or(found.clone(), |worst| worst.worse(found)));
    }
    worst.ok_or("no methods".to_owned())
}

pub fn cases(table: &mut Table) {
    let unit = boxed(1);
    let floor = Vec3::new(0.45, -0.45, 0.0);
    let camera = in_front(&at_corner(), 0.0);
    let ahead = in_front(&at_corner(), 0.8);
    let triangle =
        Arc::new(triangles(&[[-0.1, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.2, 0.0]]).expect("one"));
    let mut case = |name: &str, scene: VirtualScene, seen: Seen| {
        table.case("object", name, On::Both, |on| shown(on, &scene, seen));
    };
    case("none", VirtualScene::default(), Seen::No);
    case("a model without triangles", standing(&Arc::new(Model::default()), floor, 1.0), Seen::No);
    case("one box", standing(&unit, floor, 1.0), Seen::Yes);
    case("one triangle", standing(&triangle, ahead, 1.0), Seen::Yes);
    case("a million triangles", standing(&boxed(289), floor, 1.0), Seen::Yes);
    let thousand = (0..1000).map(|i| {
        let at = Vec3::new((i % 40) as f32 * 0.03, (i / 40) as f32 * 0.04 - 0.9, 0.0);
        placed(&unit, at, 0.1)
    });
    case("a thousand boxes", VirtualScene::from_objects(thousand.collect::<Vec<_>>()), Seen::Yes);
    let same = vec![placed(&unit, floor, 1.0); 16];
    case("sixteen boxes in one place", VirtualScene::from_objects(same), Seen::Yes);

    for (scale, seen) in [
        (0.0, Seen::No),
        (1e-45, Seen::No),
        (1e-20, Seen::No),
        (1e-6, Seen::No),
        (100.0, Seen::Yes),
        (1e6, Seen::Yes),
        (1e18, Seen::Maybe),
        (1e30, Seen::Maybe),
        (f32::MAX, Seen::Maybe),
        (-1.0, Seen::Maybe),
        (f32::NAN, Seen::No),
        (f32::INFINITY, Seen::No),
    ] {
        case(&format!("scaled by {scale:e}"), standing(&unit, floor, scale), seen);
    }
    for (name, at, scale, seen) in [
        ("behind the camera", in_front(&at_corner(), -1.0), 1.0, Seen::No),
        ("around the camera", camera - Vec3::Z, 10.0, Seen::Yes),
        ("at the camera", camera, 1.0, Seen::Maybe),
        ("across the camera's plane", camera - 0.4 * Vec3::Z, 4.0, Seen::Yes),
        ("larger than the room", in_front(&at_corner(), 1.0), 50.0, Seen::Yes),
        ("below the floor", Vec3::new(0.3, -0.3, -3.0), 1.0, Seen::No),
        ("a kilometre away", in_front(&at_corner(), 1000.0), 1.0, Seen::No),
        ("at 1e18 m", Vec3::splat(1e18), 1.0, Seen::No),
        ("at 1e30 m", Vec3::splat(-1e30), 1.0, Seen::No),
        ("at NaN", Vec3::new(0.4, f32::NAN, 0.0), 1.0, Seen::No),
        ("at infinity", Vec3::splat(f32::INFINITY), 1.0, Seen::No),
    ] {
        case(name, standing(&unit, at, scale), seen);
    }
    let quad = |normal: Vec3| {
        let (u, v) = normal.any_orthonormal_pair();
        let corner = |a: f32, b: f32| (0.4 * (a * u + b * v)).to_array();
        let [a, b, c, d] =
            [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
        Arc::new(triangles(&[a, b, c, a, c, d]).expect("two triangles"))
    };
    case(
        "in the floor's plane",
        standing(&quad(Vec3::Y), Vec3::new(0.5, -0.4, 0.0), 1.0),
        Seen::Yes,
    );
    let turned = |rotation| {
        let pose = Similarity { rotation, scale: 1.0, translation: ahead };
        VirtualScene::from_objects([VirtualObject::placed(boxed(1), pose)])
    };
    case("turned by a quaternion of zeros", turned(Quat::from_xyzw(0.0, 0.0, 0.0, 0.0)), Seen::Yes);
    case(
        "turned by a quaternion of NaN",
        turned(Quat::from_xyzw(f32::NAN, 0.0, 0.0, 1.0)),
        Seen::No,
    );
    for (name, base_color) in [
        ("black", [0.0, 0.0, 0.0, 1.0]),
        ("of albedo 1000", [1e3, 1e3, 1e3, 1.0]),
        ("of albedo NaN", [f32::NAN; 4]),
        ("of infinite albedo", [f32::INFINITY, 0.0, 0.0, 1.0]),
        ("of negative albedo", [-1.0, -1.0, -1.0, 1.0]),
    ] {
        case(name, standing(&colored(base_color, None), floor, 1.0), Seen::Yes);
    }
    for (name, color) in
        [("with a vertex of NaN colour", [f32::NAN; 4]), ("with a vertex 1e30 bright", [1e30; 4])]
    {
        case(name, standing(&colored([1.0; 4], Some(color)), floor, 1.0), Seen::Yes);
    }
    let huge = triangles(&[[-1e9, 0.0, -1e9], [1e9, 0.0, -1e9], [0.0, 0.0, 1e9]]).expect("one");
    case("a triangle of 2e9 m", standing(&Arc::new(huge), floor, 1.0), Seen::Maybe);
    let sliver = triangles(&[[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1e-20, 0.0]]).expect("one");
    case("a sliver of 1e-20 m", standing(&Arc::new(sliver), ahead, 1.0), Seen::No);
    for (name, pixel) in [
        ("waiting for a pixel outside the picture", Vec2::new(1e6, 10.0)),
        ("waiting for a pixel of NaN", Vec2::new(f32::NAN, 10.0)),
        ("standing on the pixel in the middle", Vec2::new(31.0, 30.0)),
    ] {
        let anchor = SurfaceAnchor::new(pixel, 0, 0.0, 1.0, None);
        let placement = Placement::Pending(anchor);
        let object = VirtualObject { model: unit.clone(), placement };
        let seen = if name.starts_with("standing") { Seen::Yes } else { Seen::No };
        case(name, VirtualScene::from_objects([object]), seen);
    }
    files(table);
}

/// A box of this colour, with one corner of another.
fn colored(base_color: [f32; 4], corner: Option<[f32; 4]>) -> Arc<Model> {
    let plain = boxed(1);
    let mut colors = vec![[1.0; 4]; plain.vertices().len()];
    if let Some(corner) = corner {
        colors[0] = corner;
    }
    let part = PartData {
        vertices: plain.vertices().to_vec(),
        triangles: plain.triangles().to_vec(),
        colors,
        material: Material { base_color, ..Material::default() },
    };
    Arc::new(Model::new("coloured", vec![part]).expect("as the box"))
}

/// Written as glTF, read again: triangles left, and those left out.
fn reloaded(corners: &[[f32; 3]]) -> Result<(usize, usize), String> {
    let text = |e: std::io::Error| e.to_string();
    let folder = tempfile::tempdir().map_err(text)?;
    let bytes: Vec<u8> = corners.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
    let document = json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": corners.len(), "type": "VEC3",
                       "min": [0, 0, 0], "max": [0, 0, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": bytes.len()}],
        "buffers": [{"byteLength": bytes.len(), "uri": "corners.bin"}],
    });
    let path = folder.path().join("object.gltf");
    std::fs::write(folder.path().join("corners.bin"), bytes).map_err(text)?;
    std::fs::write(&path, document.to_string()).map_err(text)?;
    let model = Model::load(&path).map_err(|e| e.to_string())?;
    Ok((model.triangles().len(), model.dropped_triangles()))
}

fn files(table: &mut Table) {
    let good = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]];
    for (name, corners) in [
        ("of NaN", [[f32::NAN; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]]),
        ("at infinity", [[0.0; 3], [f32::INFINITY, 0.0, 0.0], [0.0, 0.1, 0.0]]),
        ("at 1e38 m", [[0.0; 3], [1e38, 0.0, 0.0], [0.0, 1e38, 0.0]]),
        ("of one point", [[0.1; 3]; 3]),
        ("on a line", [[0.0; 3], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0]]),
    ] {
        table.case(
            "object",
            format!("a file with a triangle {name}: left out, counted"),
            On::Host,
            |_| {
                let found = reloaded(&[good, corners].concat())?;
                Ok(Found::broken(
                    usize::from(found != (1, 1)),
                    format!("(kept, left out) = {found:?}"),
                ))
            },
        );
    }
    for (name, line) in [
        ("scale 0", "at = [0.0, 0.0, 0.0]\nscale = 0.0"),
        ("scale -1", "at = [0.0, 0.0, 0.0]\nscale = -1.0"),
        ("scale NaN", "at = [0.0, 0.0, 0.0]\nscale = nan"),
        ("scale 1e300", "at = [0.0, 0.0, 0.0]\nscale = 1e300"),
        ("place NaN", "at = [nan, 0.0, 0.0]"),
        ("place infinite", "at = [0.0, -inf, 0.0]"),
        ("place 1e300", "at = [0.0, 1e300, 0.0]"),
        ("yaw_deg NaN", "at = [0.0, 0.0, 0.0]\nyaw_deg = nan"),
        ("up of no length", "at = [0.0, 0.0, 0.0]\nup = [0.0, 0.0, 0.0]"),
        ("pixel NaN", "on = [nan, 3.0, 0.0]"),
        ("frame 0.5", "on = [3.0, 3.0, 0.5]"),
        ("frame -1", "on = [3.0, 3.0, -1.0]"),
    ] {
        table.case("object", format!("a scene file with {name} is refused"), On::Host, move |_| {
            let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
            let path = folder.path().join("scene.toml");
            let text = format!("[[object]]\nfile = \"object.glb\"\n{line}\n");
            std::fs::write(&path, text).map_err(|e| e.to_string())?;
            let error = VirtualScene::load(&path).err().ok_or("it is taken")?.to_string();
            // which object, and which of its keys
            let key = line.rsplit('\n').next().and_then(|last| last.split(' ').next());
            let named = error.contains("object 1") && key.is_some_and(|key| error.contains(key));
            Ok(Found::broken(
                usize::from(!named),
                error.replace(&folder.path().display().to_string(), ""),
            ))
        });
    }
    table.case("object", "vertices without a normal, or of NaN, are flat", On::Host, |_| {
        let corners = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]];
        let normals = [Vec3::ZERO, Vec3::NAN, Vec3::splat(1e-30)];
        let vertices = corners.iter().zip(normals).map(|(&p, normal)| Vertex {
            position: p.into(),
            normal,
            uv: Vec2::NAN,
        });
        let part = PartData {
            vertices: vertices.collect(),
            triangles: vec![[0, 1, 2]],
            ..PartData::default()
        };
        let model = Model::new("flat", vec![part])?;
        let finite = |v: &&Vertex| v.normal.is_finite() && v.uv.is_finite();
        let bad = model.vertices().iter().filter(|v| !finite(v)).count();
        Ok(Found::broken(bad, "vertices that are not finite"))
    });
}
