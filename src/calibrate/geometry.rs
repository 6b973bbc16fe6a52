//! From folders of pictures to a calibration: one camera, or a colour camera and the depth camera
//! beside it.

use super::CalibrateError;
use super::board::{Board, BoardView, rms};
use super::corners::{find_board, other_size};
use super::coverage::{Coverage, SeenView, draw_coverage};
use super::disparity::{DisparityView, FoundDepthCamera, NO_DISPARITY, find_depth_camera};
use super::extrinsics::{FoundPlace, find_place};
use super::intrinsics::{FEWEST_VIEWS, FoundCamera, LensModel, RefusedView, find_camera};
use super::pictures::{
    COLOR_EXTENSIONS, NamedPicture, find_pictures, grey, read_pgm, read_picture,
};
use crate::capture::Calibration;
use crate::capture::calibration::Rigid;
use crate::image::{Image, Size};
use std::collections::HashMap;
use std::collections::hash_map::{DefaultHasher, Entry};
use std::hash::{Hash, Hasher};
use std::path::{Path, PathBuf};

/// Where the pictures of the depth camera are, and what they show.
#[derive(Clone, Debug)]
pub enum DepthPictures {
    /// Infrared pictures of the same boards.
    Infrared(PathBuf, LensModel),
    /// Raw disparities of a Kinect v1, PGM.
    Disparity(PathBuf),
}

#[derive(Clone, Debug)]
pub struct Plan {
    pub name: String,
    pub board: Board,
    /// Folder, or pattern with one `*`; so are those of the depth pictures.
    pub color: PathBuf,
    pub model: LensModel,
    pub depth: Option<DepthPictures>,
}

/// One camera, with every picture accounted for.
#[derive(Clone, Debug)]
pub struct CameraReport {
    pub found: FoundCamera,
    /// Pictures without a usable board, and outliers.
    pub refused: Vec<RefusedView>,
    pub coverage: Coverage,
}

#[derive(Clone, Debug)]
pub enum DepthReport {
    Infrared(Box<CameraReport>, FoundPlace),
    /// With the keys of its views.
    Disparity(FoundDepthCamera, Vec<String>),
}

#[derive(Clone, Debug)]
pub struct Outcome {
    pub calibration: Calibration,
    pub color: CameraReport,
    pub depth: Option<DepthReport>,
}

/// Finds boards, solves, and writes down what was found. `progress` is called for each picture.
pub fn calibrate(plan: &Plan, progress: &mut dyn FnMut(&str)) -> Result<Outcome, CalibrateError> {
    plan.board.check()?;
    let color = one_camera(&plan.color, &plan.board, plan.model, progress)?;
    let mut calibration = Calibration::registered(plan.name.clone(), color.found.camera);
    let views = color.found.views.len();
    calibration.notes =
        format!("Measured on {views} views of a board, {:.3} px RMS.", color.found.rms_px);
    let depth = match &plan.depth {
        None => None,
        Some(DepthPictures::Infrared(pattern, model)) => {
            let depth = one_camera(pattern, &plan.board, *model, progress)?;
            let place = find_place(
                &plan.board,
                (&color.found.camera, &color.found.views),
                (&depth.found.camera, &depth.found.views),
            )?;
            calibration.depth = Some(depth.found.camera);
            calibration.color_from_depth = Some(Rigid::from_pose(&place.color_from_depth));
            let pairs = place.pairs.len();
            calibration.notes += &format!(
                " Depth camera from infrared, {:.3} px RMS; its place from {pairs} pairs, {:.3} px RMS.",
                depth.found.rms_px, place.rms_px
            );
            Some(DepthReport::Infrared(Box::new(depth), place))
        }
        Some(DepthPictures::Disparity(pattern)) => {
            let (found, keys) = from_disparities(pattern, &plan.board, &color.found, progress)?;
            calibration.depth = Some(found.depth);
            calibration.color_from_depth = Some(Rigid::from_pose(&found.color_from_depth));
            calibration.disparity = Some(found.disparity);
            calibration.invalid_depth = vec![0, NO_DISPARITY];
            calibration.notes += &format!(
                " Depth camera from {} planes, {:.2} units of disparity RMS.",
                keys.len(),
                found.rms
            );
            Some(DepthReport::Disparity(found, keys))
        }
    };
    calibration.registered = depth.is_none();
    calibration.check().map_err(CalibrateError::Data)?;
    Ok(Outcome { calibration, color, depth })
}

fn one_camera(
    pattern: &Path,
    board: &Board,
    model: LensModel,
    progress: &mut dyn FnMut(&str),
) -> Result<CameraReport, CalibrateError> {
    let pictures = find_pictures(pattern, &COLOR_EXTENSIONS)?;
    let Sorted { size, views, mut refused } = sort_pictures(&pictures, board, progress)?;
    if views.len() < FEWEST_VIEWS {
        return Err(CalibrateError::Data(too_few(&pictures, views.len(), board, &refused)?));
    }
    let about = |e: CalibrateError| match e {
        CalibrateError::Data(problem) => {
            CalibrateError::Data(format!("{}: {problem}", pattern.display()))
        }
        other => other,
    };
    let found = find_camera(board, &views, size, model).map_err(about)?;
    refused.extend(found.outliers.iter().map(|(_, refused)| refused.clone()));
    let coverage = coverage(board, &found, size);
    if let Some(warning) = coverage.warning() {
        log::warn!("{}: {warning}", pattern.display());
    }
    Ok(CameraReport { found, refused, coverage })
}

struct Sorted {
    size: Size,
    views: Vec<BoardView>,
    refused: Vec<RefusedView>,
}

/// Boards of all pictures that are of the commonest size and not copies of others.
fn sort_pictures(
    pictures: &[NamedPicture],
    board: &Board,
    progress: &mut dyn FnMut(&str),
) -> Result<Sorted, CalibrateError> {
    let mut looked: Vec<(&NamedPicture, Size, Result<BoardView, String>)> = Vec::new();
    let mut seen: HashMap<u64, &str> = HashMap::new();
    for picture in pictures {
        progress(&picture.key);
        let pixels = grey(&read_picture(&picture.path)?);
        let mut hasher = DefaultHasher::new();
        (pixels.width(), pixels.as_slice()).hash(&mut hasher);
        let found = match seen.entry(hasher.finish()) {
            Entry::Occupied(same) => Err(format!("the same picture as {}", same.get())),
            Entry::Vacant(new) => {
                new.insert(&picture.key);
                find_board(&picture.key, &pixels, board)?
            }
        };
        looked.push((picture, pixels.size(), found));
    }
    let times = |size: Size| looked.iter().filter(|l| l.1 == size).count();
    // Of two sizes as common, that of the first picture.
    let size = looked.iter().map(|l| l.1).rev().max_by_key(|&size| times(size));
    let size = size.ok_or(CalibrateError::Options("no pictures".into()))?;
    let (mut views, mut refused) = (Vec::new(), Vec::new());
    for (picture, own, found) in looked {
        let usable =
            if own == size { found } else { Err(format!("{own} pixels, most have {size}")) };
        match usable {
            Ok(view) => views.push(view),
            Err(reason) => {
                log::warn!("{}: {reason}", picture.path.display());
                refused.push(RefusedView { key: picture.key.clone(), reason });
            }
        }
    }
    Ok(Sorted { size, views, refused })
}

/// Why pictures do not do, by name.
fn too_few(
    pictures: &[NamedPicture],
    usable: usize,
    board: &Board,
    refused: &[RefusedView],
) -> Result<String, CalibrateError> {
    const NAMED: usize = 8;
    let mut text = format!("{usable} usable views of the board, {FEWEST_VIEWS} are needed");
    let named = refused.iter().take(NAMED).map(|r| format!("{} ({})", r.key, r.reason));
    let named: Vec<String> = named.collect();
    if !named.is_empty() {
        text += &format!("; refused: {}", named.join(", "));
    }
    if refused.len() > NAMED {
        text += &format!(" and {} more", refused.len() - NAMED);
    }
    if usable == 0 && board.markers.is_none() {
        for picture in pictures.iter().take(3) {
            if let Some((columns, rows)) = other_size(&grey(&read_picture(&picture.path)?), board)?
            {
                text += &format!(
                    ". {} shows a board of {columns}x{rows} inner corners: count where four squares \
                     meet, not squares",
                    picture.key
                );
                break;
            }
        }
    }
    Ok(text)
}

fn coverage(board: &Board, found: &FoundCamera, size: Size) -> Coverage {
    let outliers = found.outliers.iter().map(|(view, _)| (view, true));
    let all: Vec<_> = found
        .views
        .iter()
        .map(|view| (view, false))
        .chain(outliers)
        .map(|(view, refused)| (view, view.residuals(&found.camera, board), refused))
        .collect();
    let seen: Vec<_> = all
        .iter()
        .map(|(v, residuals, refused)| SeenView { view: &v.view, residuals, refused: *refused })
        .collect();
    draw_coverage(size, &seen)
}

/// The depth camera from the disparity pictures that go with used colour views.
fn from_disparities(
    pattern: &Path,
    board: &Board,
    color: &FoundCamera,
    progress: &mut dyn FnMut(&str),
) -> Result<(FoundDepthCamera, Vec<String>), CalibrateError> {
    let mut pairs: Vec<(usize, Image<u16>)> = Vec::new();
    for picture in find_pictures(pattern, &["pgm"])? {
        progress(&picture.key);
        match color.views.iter().position(|v| v.view.key == picture.key) {
            Some(at) => pairs.push((at, read_pgm(&picture.path)?)),
            None => log::warn!("{}: no usable colour picture with it", picture.path.display()),
        }
    }
    let views: Vec<_> = pairs
        .iter()
        .map(|(at, disparity)| DisparityView { colored: &color.views[*at], disparity })
        .collect();
    let found = find_depth_camera(board, &views)?;
    Ok((found, views.iter().map(|v| v.colored.view.key.clone()).collect()))
}

/// RMS reprojection error of each used view, pixels.
pub fn view_errors(board: &Board, found: &FoundCamera) -> Vec<(String, f64)> {
    let error = |v: &super::board::PosedView| rms(&v.residuals(&found.camera, board));
    found.views.iter().map(|v| (v.view.key.clone(), error(v))).collect()
}
