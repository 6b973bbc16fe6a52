//! The page and its figures for records as they come, and for those that nobody hopes for.

use super::figures::{self, BarScale, ErrorMeasure};
use super::fixtures;
use super::{Sources, page, sources};
use crate::study::light::{LightStudy, StepTrace};
use crate::study::tradeoff::Tradeoff;
use roxmltree::Document;
use std::path::PathBuf;

/// Parses, holds no number that is none, and draws nothing outside of its picture.
fn check_svg(svg: &str) {
    let document = Document::parse(svg).unwrap_or_else(|e| panic!("{e}\n{svg}"));
    let root = document.root_element();
    assert_eq!(root.tag_name().name(), "svg");
    assert_eq!(root.tag_name().namespace(), Some("http://www.w3.org/2000/svg"));
    let size = |name: &str| root.attribute(name).unwrap().parse::<f64>().unwrap();
    let (width, height) = (size("width"), size("height"));
    assert!(width > 0.0 && width < 1e5 && height > 0.0 && height < 1e5);
    for node in document.descendants().filter(|n| n.is_element()) {
        for (names, limit) in [(["x", "x1", "x2", "cx"], width), (["y", "y1", "y2", "cy"], height)]
        {
            for text in names.into_iter().filter_map(|name| node.attribute(name)) {
                let value: f64 = text.parse().unwrap();
                assert!((-1.0..=limit + 1.0).contains(&value), "{value} of {limit} in {node:?}");
            }
        }
        for point in node.attribute("points").unwrap_or_default().split_whitespace() {
            let (x, y) = point.split_once(',').unwrap();
            let (x, y): (f64, f64) = (x.parse().unwrap(), y.parse().unwrap());
            assert!((0.0..=width).contains(&x) && (0.0..=height).contains(&y), "{point}");
        }
    }
    assert!(!svg.contains("NaN") && !svg.contains(">inf"), "{svg}");
}

fn count(svg: &str, tag: &str, class: &str) -> usize {
    let document = Document::parse(svg).unwrap();
    let wanted = |n: &roxmltree::Node| {
        n.has_tag_name(("http://www.w3.org/2000/svg", tag))
            && n.attribute("class").is_some_and(|c| c.split(' ').any(|word| word == class))
    };
    document.descendants().filter(wanted).count()
}

fn all_figures(study: &LightStudy, tradeoff: &Tradeoff) -> Vec<String> {
    let mut all = Vec::new();
    for noise in [false, true] {
        all.push(figures::angle_boxes(study, noise));
        all.push(figures::step_curves(study, noise));
        all.extend((0..5).map(|light| figures::environment_dots(study, light, noise, None)));
    }
    all.extend(ErrorMeasure::ALL.map(|measure| figures::pareto(tradeoff, measure)));
    all
}

#[test]
fn figures_show_every_record() {
    let (study, tradeoff) = (fixtures::light_study(), fixtures::tradeoff());
    all_figures(&study, &tradeoff).iter().for_each(|svg| check_svg(svg));
    let boxes = figures::angle_boxes(&study, true);
    assert_eq!(count(&boxes, "rect", "box"), 6 * 4);
    let dots = figures::environment_dots(&study, 2, false, Some("data:image/png;base64,AA=="));
    check_svg(&dots);
    assert_eq!((count(&dots, "circle", "dot"), count(&dots, "circle", "faint")), (4, 4 * 6));
    assert!(dots.contains("data:image/png;base64,AA=="));
    let steps = figures::step_curves(&study, false);
    assert_eq!(count(&steps, "polyline", "line"), 9);
    assert_eq!(count(&steps, "circle", "dot"), 8, "one never settles");
    let pareto = figures::pareto(&tradeoff, ErrorMeasure::LightAngle);
    let rings = count(&pareto, "circle", "front");
    let dots = count(&pareto, "circle", "dot") + count(&pareto, "circle", "faint");
    assert_eq!((rings, dots), (2, tradeoff.points.len()));
    let bars = figures::stage_bars(&fixtures::STAGES_MS, BarScale::Milliseconds);
    check_svg(&bars);
    assert!(bars.contains("ours-fast, RadTransfer: 20.80 ms"));
}

#[test]
fn figures_of_nothing_and_of_strange_values_are_whole() {
    let study = fixtures::light_study();
    let tradeoff = fixtures::tradeoff();
    let mut empty = study.clone();
    (empty.runs, empty.steps) = (vec![], vec![]);
    let no_points = Tradeoff { points: vec![], ..tradeoff.clone() };
    all_figures(&empty, &no_points).iter().for_each(|svg| check_svg(svg));

    let mut strange = study.clone();
    strange.scenes[0] = "<a very long & \"quoted\" name of a scene that does not fit>".into();
    strange.methods[1] = "<&> a method with a very long name that goes on and on and on".into();
    for (i, run) in strange.runs.iter_mut().enumerate() {
        if run.scene == study.scenes[0] {
            run.scene.clone_from(&strange.scenes[0]);
        }
        run.true_direction = if i % 5 == 0 { [f64::NAN; 3] } else { run.true_direction };
        run.frames.truncate(i % 3);
        for frame in &mut run.frames {
            frame.angle_deg = [None, Some(f64::NAN), Some(f64::INFINITY), Some(0.0)][i % 4];
            frame.direction = if i % 2 == 0 { None } else { Some([0.0; 3]) };
        }
    }
    for step in &mut strange.steps {
        step.trace.push(StepTrace { frame: 3, distance: f64::NAN, angle_deg: None });
        step.settled_after = Some(usize::MAX - step.switch_frame);
    }
    let mut points = tradeoff.clone();
    for (i, point) in points.points.iter_mut().enumerate() {
        point.update_ms = [0.0, -1.0, f64::NAN, 1e-30, 1e30, 5.0][i % 6];
        point.light_angle_deg = [Some(f64::INFINITY), Some(7.0), Some(1e200)][i % 3];
        point.name = "\u{1}]]>".repeat(9);
    }
    all_figures(&strange, &points).iter().for_each(|svg| check_svg(svg));
    let one = Tradeoff { points: tradeoff.points[..1].to_vec(), ..tradeoff };
    check_svg(&figures::pareto(&one, ErrorMeasure::LightAngle));
    let rows =
        [("none", [0.0; 7]), ("<strange>", [f64::NAN, f64::INFINITY, -1.0, 0.0, 0.0, 0.0, 1.0])];
    for scale in [BarScale::Milliseconds, BarScale::Percent] {
        check_svg(&figures::stage_bars(&rows, scale));
        check_svg(&figures::stage_bars(&rows[..1], scale));
        check_svg(&figures::stage_bars(&[], scale));
    }
}

fn run_folder(name: &str, stages_ms: [f64; 7]) -> sources::RunFolder {
    sources::RunFolder {
        folder: PathBuf::from("out").join(name),
        name: name.into(),
        made_by: None,
        timings: Some(fixtures::timings(stages_ms)),
        summary: None,
        settings: Some("[transfer]\ndirections = 32\n".parse().unwrap()),
        frames: vec![],
    }
}

fn all_sources() -> Sources {
    fn found<T>(record: T) -> sources::Found<T> {
        sources::Found { folder: "no/such/folder".into(), record }
    }
    Sources {
        light: vec![found(fixtures::light_study())],
        composite: vec![found(fixtures::composite_study())],
        tradeoff: vec![found(fixtures::tradeoff())],
        runs: fixtures::STAGES_MS.map(|(name, ms)| run_folder(name, ms)).to_vec(),
        problems: vec![],
    }
}

fn section_ids(page: &str) -> Vec<String> {
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
    let document = Document::parse_with_options(page, options).unwrap_or_else(|e| panic!("{e}"));
    let sections = document.descendants().filter(|n| n.has_tag_name("section"));
    sections.map(|n| n.attribute("id").unwrap().to_owned()).collect()
}

#[test]
fn the_page_has_a_section_for_each_record() {
    let page = page(&all_sources()).html;
    let all =
        ["summary", "tables", "stages", "light", "steps", "tradeoff", "composite", "settings"];
    assert_eq!(section_ids(&page), all);
    // Table 1: the paper's RadTransfer, and the ratio measured here
    assert!(page.contains(">36.22<") && page.contains(">130.48<"));
    assert!(page.contains("<b>10.7\u{d7}</b>"), "222.5 / 20.8");
    assert!(!page.contains("Not measured yet"));
    assert!(page.contains("&lt;test&gt;") && page.contains("&#39;a &amp; b&#39;"));
    for outside in ["src=\"http", "href=\"http", "url(http", "@import", "NaN"] {
        assert!(!page.contains(outside), "{outside}");
    }
}

#[test]
fn a_page_of_less_says_what_is_missing() {
    let sources =
        Sources { runs: vec![run_folder("ours", fixtures::STAGES_MS[0].1)], ..Sources::default() };
    let page = page(&sources).html;
    assert_eq!(section_ids(&page), ["summary", "tables", "stages", "settings"]);
    assert!(page.contains("kinlight study light") && page.contains("kinlight tradeoff"));
    assert!(!page.contains("kinlight compare"));
    let mut broken = all_sources();
    for run in &mut broken.light[0].record.runs {
        run.frames.clear();
    }
    broken.tradeoff[0].record.points.clear();
    broken.composite[0].record.runs.clear();
    broken.runs.clear();
    section_ids(&super::page(&broken).html);
    section_ids(&super::page(&Sources::default()).html);
}

#[test]
fn variants_are_compared_with_their_own_preset() {
    let page = page(&all_sources()).html;
    // (0.46 + d) / (0.40 + d) - 1 over the sequences and objects of the fixture, d as it adds there
    let d = |s: usize, o: usize| 0.02 * s as f64 + 0.01 * o as f64 + 0.004;
    let ratios = (0..6).map(|i| (0.46 + d(i / 3, i % 3)) / (0.40 + d(i / 3, i % 3)) - 1.0);
    let mean = ratios.sum::<f64>() / 6.0;
    assert!(page.contains(&format!("+{:.1} %", 100.0 * mean)), "{mean}");
}
