//! What a colour picture may hold.

use crate::frames::{SIZE, at_corner, picture, seen};
use crate::models::on_floor;
use crate::runs::{run, settings};
use crate::table::{On, Table};
use kinlight::image::Image;
use kinlight::lighting::Rejection;
use kinlight::math::random::hash;
use kinlight::scene::analytic::AnalyticScene;

pub fn cases(table: &mut Table) {
    let mut case = |name: &str, rejection: Option<Option<Rejection>>, color: Image<[u8; 3]>| {
        for channels in ["intensity", "rgb"] {
            let name = format!("{name}, light of {channels}");
            table.case("colour", name, On::Both, |on| {
                let settings = settings(&[("light.channels", channels)])?;
                let frames = [0, 1, 2].map(|index| kinlight::capture::RawFrame {
                    color: color.clone(),
                    ..seen(&AnalyticScene::corner(), SIZE, at_corner(), index)
                });
                let mut run = run(on, &settings, on_floor(), &frames)?;
                let found = run.outcomes[2].light.rejection;
                run.broken
                    .rule(rejection.is_none_or(|r| r == found), || format!("the light: {found:?}"));
                run.broken.rule(run.outcomes[2].composed, || "it is not composed".to_owned());
                run.finish()
            });
        }
    };
    let dark = Some(Some(Rejection::TooDark));
    let saturated = Some(Some(Rejection::Saturated));
    let plain = |code: u8| Image::new(SIZE, [code; 3]);
    case("all black", dark, plain(0));
    case("all saturated", saturated, plain(255));
    case("all at the darkest that counts", Some(None), plain(6));
    case("all at the brightest that counts", Some(None), plain(249));
    case("one lit pixel", dark, picture(SIZE, |u, v| [255 * u8::from((u, v) == (31, 23)); 3]));
    case(
        "one dark pixel",
        saturated,
        picture(SIZE, |u, v| [255 * u8::from((u, v) != (31, 23)); 3]),
    );
    case("columns of black and white", None, picture(SIZE, |u, _| [255 * (u % 2) as u8; 3]));
    case("columns of 30 and 220", Some(None), picture(SIZE, |u, _| [30 + 190 * (u % 2) as u8; 3]));
    case("rows of 30 and 220", Some(None), picture(SIZE, |_, v| [30 + 190 * (v % 2) as u8; 3]));
    case(
        "chequered 30 and 220",
        Some(None),
        picture(SIZE, |u, v| [30 + 190 * ((u + v) % 2) as u8; 3]),
    );
    case(
        "noise",
        None,
        picture(SIZE, |u, v| [0u32, 1, 2].map(|c| hash((3 * (u * 97 + v)) as u32 + c) as u8)),
    );
    case("red alone", None, picture(SIZE, |_, _| [200, 0, 0]));
    case("blue alone, saturated", saturated, picture(SIZE, |_, _| [0, 0, 255]));
    table.case("colour", "grey, black, white, grey again", On::Both, |on| {
        let codes = [120u8, 0, 255, 120, 120, 120];
        let frames = std::array::from_fn::<_, 6, _>(|index| kinlight::capture::RawFrame {
            color: plain(codes[index]),
            ..seen(&AnalyticScene::corner(), SIZE, at_corner(), index)
        });
        let mut run = run(on, &settings(&[])?, on_floor(), &frames)?;
        let valid: Vec<bool> = run.outcomes.iter().map(|o| o.light.valid()).collect();
        let expected = [true, false, false, true, true, true];
        run.broken.rule(valid == expected, || format!("valid: {valid:?}"));
        run.finish()
    });
}
