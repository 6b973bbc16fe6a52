//! The scenes that come with the program, in order of growing richness of shape.

use super::light::Environment;
use super::material::{Albedo, Material};
use super::props::{
    armchair, book_stack, bowl, cone, desk_lamp, floor, hand, keyboard, low_table, mug, pen_pot,
    picture, plant, screen, shelf, table, vase, vec_a, wall_behind, wood,
};
use super::scene::{CameraPath, NamedLight, Object, Scene, VirtualKind, light_around};
use super::shape::Shape;
use super::still_life::{apple, bottle, drapery, goblet, gourd, pear, plate, ring};
use glam::{DVec3, Vec3A, vec3};

pub const NAMES: [&str; 6] = STUDY;

/// The six scenes of studies, as Gruber et al. 2015 (Sec. 6.2) chose theirs: from a ball alone to
/// rich geometry.
///
/// | | scene | shapes | albedo |
/// | --- | --- | --- | --- |
/// | 1 | `sphere` | ball and two blocks before a corner | one grey |
/// | 2 | `blocks` | four boxes on a table: few directions of normals | strong colours, checker |
/// | 3 | `desk` | flat things: screen, keyboard, paper; few round ones | dark and bright |
/// | 4 | `demo` | books, vase, mug, bowl, ball, cone; a hand from 0.9 s on | wood, stripes, checker |
/// | 5 | `still-life` | vessels, fruit, a draped cloth: normals everywhere | natural |
/// | 6 | `room` | shelf, seat, plant, carpet: large and small together | textured |
pub const STUDY: [&str; 6] = ["sphere", "blocks", "desk", "demo", "still-life", "room"];

pub fn by_name(name: &str) -> Option<Scene> {
    match name {
        "sphere" => Some(sphere()),
        "blocks" => Some(blocks()),
        "desk" => Some(desk()),
        "demo" => Some(demo()),
        "still-life" => Some(still_life()),
        "room" => Some(room()),
        _ => None,
    }
}

/// A hand-held look at the middle of a table, and what all scenes share.
fn table_scene(name: &'static str, note: &'static str, light_azimuth_deg: f32) -> Scene {
    let centre = DVec3::new(0.0, 0.0, 0.1);
    let key = light_around(centre.as_vec3().into(), light_azimuth_deg, 46.0);
    Scene {
        name,
        note,
        objects: Vec::new(),
        lights: vec![NamedLight { name: "key".into(), light: key }],
        environment: Environment::Uniform(Vec3A::splat(0.13)),
        motions: Vec::new(),
        camera_path: CameraPath {
            eye: DVec3::new(0.06, -0.92, 0.56),
            target: DVec3::new(0.0, 0.0, 0.06),
            eye_swing: DVec3::new(0.10, 0.03, 0.05),
            target_swing: DVec3::new(0.03, 0.02, 0.02),
            roll_rad: 0.03,
            period_s: 3.1,
        },
        exposure: 1.2,
        centre,
        probe: DVec3::new(0.0, -0.1, 0.45),
        virtual_at: vec3(0.0, -0.16, 0.0),
        virtual_kind: VirtualKind::Figure,
    }
}

/// A ball and two blocks on a plate before a corner: little else than what tracking needs.
fn sphere() -> Scene {
    let grey = Material::diffuse(0.55, 0.55, 0.55);
    let mut scene = table_scene("sphere", "ball and two blocks on a plate before a corner", 190.0);
    scene.virtual_kind = VirtualKind::Diffuse;
    scene.exposure = 0.9;
    scene.objects = vec![
        floor(0.0, 1.6, grey.clone()),
        wall_behind(0.7, 1.6, grey.clone()),
        // Low enough that lamps on its side shine over it.
        Object::new(Shape::block(0.02, 1.4, 0.4), grey.clone(), vec3(0.75, 0.0, 0.2)),
        Object::new(Shape::sphere(0.16), grey.clone(), vec3(-0.12, 0.18, 0.16)),
        Object::new(Shape::block(0.2, 0.14, 0.12), grey.clone(), vec3(0.28, 0.1, 0.06)).yawed(25.0),
        Object::new(Shape::block(0.08, 0.08, 0.26), grey, vec3(-0.42, 0.05, 0.13)).yawed(-15.0),
    ];
    scene
}

/// Four boxes, little turned: hardly more than the six directions of their faces, and colours that
/// are no grey world.
fn blocks() -> Scene {
    let mut scene = table_scene("blocks", "four boxes in strong colours on a table", 205.0);
    scene.objects.push(floor(-0.74, 3.0, Material::diffuse(0.30, 0.30, 0.30)));
    scene.objects.push(wall_behind(0.66, 3.0, Material::diffuse(0.50, 0.42, 0.20)));
    scene.objects.extend(table(1.36, 0.92));
    let checker =
        Albedo::Checker { colors: [vec_a(0.70, 0.70, 0.68), vec_a(0.04, 0.04, 0.05)], cell: 0.05 };
    let boxes = [
        (0.22, 0.14, 0.20, -0.30, 0.16, 12.0, Material::diffuse(0.52, 0.05, 0.04)),
        (0.16, 0.16, 0.10, 0.02, 0.24, -8.0, Material::diffuse(0.06, 0.34, 0.09)),
        (0.12, 0.20, 0.28, 0.32, 0.18, 20.0, Material::diffuse(0.05, 0.11, 0.42)),
        (0.15, 0.15, 0.15, 0.38, -0.14, 35.0, Material::of(checker)),
    ];
    for (width, depth, height, x, y, yaw, material) in boxes {
        let block = Shape::block(width, depth, height);
        scene.objects.push(Object::new(block, material, vec3(x, y, height * 0.5)).yawed(yaw));
    }
    scene
}

/// A table with things on it before a wall, and a hand that reaches across.
fn demo() -> Scene {
    let mut scene = table_scene(
        "demo",
        "table, books, vase, mug, bowl, ball, block, cone; a hand crosses in the second half",
        187.0,
    );
    scene.environment = Environment::Uniform(Vec3A::new(0.12, 0.135, 0.155));
    scene.objects.push(floor(-0.74, 3.0, Material::diffuse(0.30, 0.27, 0.25)));
    let plaster =
        Albedo::Grain { colors: [vec_a(0.50, 0.48, 0.44), vec_a(0.56, 0.54, 0.50)], cell: 0.05 };
    scene.objects.push(wall_behind(0.78, 3.0, Material::of(plaster)));
    scene.objects.extend(picture(vec3(-0.30, 0.765, 0.36), 0.44, 0.34));
    scene.objects.extend(table(1.36, 0.92));
    scene.objects.extend(book_stack(vec3(0.33, 0.22, 0.0)));
    scene.objects.push(vase(vec3(-0.36, 0.24, 0.0), 1.0));
    scene.objects.extend(mug(vec3(-0.25, -0.02, 0.0), 205.0, [0.12, 0.25, 0.42]));
    scene.objects.push(bowl(vec3(0.36, -0.12, 0.0)));
    let checker =
        Albedo::Checker { colors: [vec_a(0.62, 0.60, 0.52), vec_a(0.40, 0.09, 0.07)], cell: 0.035 };
    scene.objects.push(
        Object::new(Shape::block(0.14, 0.14, 0.14), Material::of(checker), vec3(0.04, 0.20, 0.07))
            .yawed(32.0),
    );
    let orange = Material::diffuse(0.62, 0.24, 0.05).coated(0.35);
    scene.objects.push(Object::new(Shape::sphere(0.045), orange, vec3(-0.44, -0.10, 0.045)));
    scene.objects.push(cone(vec3(-0.13, 0.32, 0.0)));
    let (motion, hand) = hand(0);
    scene.motions.push(motion);
    scene.objects.extend(hand);
    scene
}

/// A work place: screen, keyboard, lamp, paper and many small things.
fn desk() -> Scene {
    let mut scene =
        table_scene("desk", "desk with screen, keyboard, lamp, books, paper, pens", -8.0);
    scene.camera_path.eye = DVec3::new(-0.10, -0.98, 0.62);
    scene.virtual_at = vec3(0.12, -0.22, 0.0);
    scene.objects.push(floor(-0.74, 3.0, Material::diffuse(0.26, 0.28, 0.31)));
    scene.objects.push(wall_behind(0.60, 3.0, Material::diffuse(0.50, 0.52, 0.50)));
    scene.objects.extend(table(1.6, 1.0));
    scene.objects.extend(screen(vec3(-0.08, 0.30, 0.0)));
    scene.objects.extend(keyboard(vec3(-0.16, -0.06, 0.0)));
    scene.objects.extend(book_stack(vec3(0.45, 0.24, 0.0)));
    scene.objects.extend(mug(vec3(0.30, -0.02, 0.0), -30.0, [0.45, 0.12, 0.09]));
    scene.objects.extend(desk_lamp(vec3(-0.56, 0.26, 0.0)));
    let lines = Albedo::Stripes {
        colors: [vec_a(0.66, 0.66, 0.64), vec_a(0.30, 0.32, 0.40)],
        axis: 1,
        period: 0.012,
        share: 0.75,
    };
    scene.objects.push(
        Object::new(
            Shape::block(0.21, 0.297, 0.004),
            Material::of(lines),
            vec3(0.42, -0.20, 0.002),
        )
        .yawed(-12.0),
    );
    scene.objects.extend(pen_pot(vec3(0.24, 0.22, 0.0)));
    let mouse = Shape::Ellipsoid { radii: Vec3A::new(0.032, 0.055, 0.026) };
    let dark = Material::diffuse(0.06, 0.06, 0.065).coated(0.4);
    scene.objects.push(Object::new(mouse, dark, vec3(0.13, -0.05, 0.008)).yawed(8.0));
    scene.objects.push(vase(vec3(-0.42, 0.02, 0.0), 0.7));
    scene
}

/// Vessels and fruit before a draped cloth: normals in every direction that a camera can see.
fn still_life() -> Scene {
    let mut scene =
        table_scene("still-life", "vessels and fruit on a table before a draped cloth", 172.0);
    scene.objects.push(floor(-0.74, 3.0, Material::diffuse(0.30, 0.27, 0.25)));
    scene.objects.push(wall_behind(0.70, 3.0, Material::diffuse(0.46, 0.44, 0.42)));
    scene.objects.extend(table(1.36, 0.92));
    scene.objects.push(drapery(0.62, 1.5));
    scene.objects.push(vase(vec3(-0.34, 0.16, 0.0), 1.0));
    scene.objects.push(bottle(vec3(0.14, 0.20, 0.0)));
    scene.objects.push(goblet(vec3(0.37, 0.02, 0.0)));
    scene.objects.push(plate(vec3(-0.04, 0.09, 0.0)));
    scene.objects.push(apple(vec3(-0.08, 0.07, 0.011), [0.48, 0.09, 0.06]));
    scene.objects.push(apple(vec3(0.0, 0.12, 0.011), [0.28, 0.36, 0.09]));
    scene.objects.push(pear(vec3(0.02, 0.035, 0.013), 0.12));
    scene.objects.push(bowl(vec3(0.33, 0.22, 0.0)));
    scene.objects.push(gourd(vec3(-0.44, -0.10, 0.0), 20.0));
    scene.objects.push(ring(vec3(0.34, -0.18, 0.0), 0.062, 0.018));
    scene.objects.extend(mug(vec3(-0.20, 0.02, 0.0), 220.0, [0.44, 0.40, 0.34]));
    scene
}

/// A corner of a room: shelf with books and vessels, seat, low table, plant, carpet.
fn room() -> Scene {
    let mut scene =
        table_scene("room", "room corner with shelf, armchair, low table, plant", 235.0);
    scene.camera_path = CameraPath {
        eye: DVec3::new(0.15, -1.45, 0.80),
        target: DVec3::new(0.02, 0.12, 0.06),
        ..scene.camera_path
    };
    scene.objects.push(floor(-0.42, 4.0, wood([0.30, 0.20, 0.12], [0.40, 0.28, 0.17], 0.05)));
    let carpet =
        Albedo::Checker { colors: [vec_a(0.32, 0.12, 0.10), vec_a(0.45, 0.38, 0.28)], cell: 0.22 };
    scene.objects.push(Object::new(
        Shape::block(1.9, 1.5, 0.016),
        Material::of(carpet),
        vec3(-0.05, 0.0, -0.412),
    ));
    let wall = Material::diffuse(0.50, 0.50, 0.46);
    scene.objects.push(wall_behind(1.05, 4.0, wall.clone()));
    scene.objects.push(Object::new(Shape::block(0.04, 4.0, 3.0), wall, vec3(-1.72, 0.0, 1.0)));
    scene.objects.extend(picture(vec3(0.55, 1.03, 0.72), 0.5, 0.38));
    scene.objects.extend(low_table());
    scene.objects.extend(shelf(vec3(-0.62, 0.90, -0.42)));
    scene.objects.extend(armchair(vec3(0.85, 0.45, -0.42)));
    scene.objects.extend(plant(vec3(0.28, 0.80, -0.42)));
    scene.objects.extend(book_stack(vec3(0.18, 0.10, 0.0)));
    scene.objects.extend(mug(vec3(-0.22, 0.05, 0.0), 200.0, [0.10, 0.30, 0.22]));
    scene.objects.push(bowl(vec3(0.25, -0.14, 0.0)));
    scene
}
