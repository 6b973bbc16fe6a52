//! The truth about sequences, what runs and studies leave behind, and what `kinlight calibrate` reads.

use super::{Scratch, accepted};
use crate::calibrate::{chart, pictures};
use crate::capture::calibration::Photometry;
use crate::eval::light::LightTruth;
use crate::report::{Sources, page};
use crate::study::composite::TruthFolder;
use crate::synth::read_environment;
use glam::Vec2;

/// `light.json`, `virtual.json`, a picture of light, or the records of a report.
pub fn records(data: &[u8], scratch: &Scratch) -> bool {
    let Some((kind, rest)) = data.split_first() else { return false };
    let folder = scratch.folder("records");
    match kind {
        b'l' => {
            let path = folder.join("light.json");
            scratch.write(&path, rest);
            accepted(LightTruth::read(&path).map(|truth| {
                let first = truth.segments[0].first_frame;
                assert!(truth.at_frame(first).is_some());
            }))
        }
        b'v' => {
            scratch.write(&folder.join("virtual.json"), rest);
            accepted(TruthFolder::open(&folder).map(|truth| {
                for &frame in truth.frames().iter().take(4) {
                    accepted(truth.frame(frame));
                }
                accepted(truth.scene());
            }))
        }
        b'h' => {
            let path = folder.join("sky.hdr");
            scratch.write(&path, rest);
            accepted(read_environment(&path).map(|sky| {
                let sample = sky.sample(Vec2::new(0.3, 0.7));
                assert!(sample.pdf.is_finite() && sample.radiance.is_finite());
            }))
        }
        b's' => reported(scratch, "study.json", rest),
        b't' => reported(scratch, "timings.json", rest),
        b'u' => reported(scratch, "summary.json", rest),
        _ => reported(scratch, "run.json", rest),
    }
}

/// A page of what one record says.
fn reported(scratch: &Scratch, name: &str, content: &[u8]) -> bool {
    let folder = scratch.emptied("report");
    scratch.write(&folder.join(name), content);
    if name == "run.json" {
        scratch.write(&folder.join("summary.json"), b"{}");
    }
    let sources = Sources::find(&[folder]);
    let page = page(&sources);
    assert!(page.html.ends_with("</html>\n"));
    sources.problems.is_empty() && !sources.is_empty()
}

/// A chart's codes, a list of exposures, a picture of disparities.
pub fn calibrate(data: &[u8], scratch: &Scratch) -> bool {
    let Some((kind, rest)) = data.split_first() else { return false };
    let folder = scratch.folder("calibrate");
    let path = folder.join("given");
    scratch.write(&path, rest);
    match kind {
        b'c' => accepted(chart::read_codes(&path).and_then(|codes| {
            let patches = chart::patches_from_codes(&codes, &Photometry::default());
            chart::find_matrix(&patches, &chart::reference(&chart::SRGB_CODES))
        })),
        b'e' => accepted(pictures::read_exposure_list(&path).map(|list| {
            assert!(list.iter().all(|(picture, _)| picture.starts_with(&folder)));
        })),
        _ => accepted(pictures::read_pgm(&path).map(|picture| {
            assert_eq!(picture.as_slice().len(), picture.size().pixels());
        })),
    }
}
