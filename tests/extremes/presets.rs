//! Every preset on frames that show nothing, or nothing sane.

use crate::frames::{SIZE, at_corner, blank, picture, seen};
use crate::models::on_floor;
use crate::runs::run;
use crate::table::{On, Table};
use kinlight::capture::RawFrame;
use kinlight::config::{Settings, presets};
use kinlight::image::Image;
use kinlight::math::random::{hash, unit_f32};
use kinlight::scene::analytic::AnalyticScene;

pub fn cases(table: &mut Table) {
    let pose = Some(at_corner());
    let empty = RawFrame { color: Image::new(SIZE, [0; 3]), ..blank(SIZE, 0, pose) };
    let flat = RawFrame { depth_m: Image::new(SIZE, 1.0), ..blank(SIZE, 0, pose) };
    let noise = |u: usize, v: usize| unit_f32(hash((u * 131 + v) as u32));
    let torn = RawFrame {
        depth_m: picture(SIZE, |u, v| match u % 3 {
            0 => f32::NAN,
            1 => 0.0,
            _ => 0.3 + 4.0 * noise(u, v),
        }),
        color: picture(SIZE, |u, v| [(255.0 * noise(v, u)) as u8; 3]),
        ..blank(SIZE, 0, pose)
    };
    let corner = seen(&AnalyticScene::corner(), SIZE, at_corner(), 0);
    for preset in presets::ALL {
        for (name, frame) in
            [("empty", &empty), ("one depth", &flat), ("torn", &torn), ("the corner", &corner)]
        {
            table.case("preset", format!("{}: {name}", preset.name), On::Both, |on| {
                let settings = Settings::preset(preset.name).map_err(|e| e.to_string())?;
                let frames = [0, 1].map(|index| RawFrame { index, ..frame.clone() });
                run(on, &settings, on_floor(), &frames)?.finish()
            });
        }
    }
}
