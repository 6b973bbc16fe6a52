//! Boards in pictures.

use super::CalibrateError;
use super::board::{Board, BoardView, Markers};
use crate::image::Image;
use opencv::core::{Mat, Point2f, Ptr, Size as CvSize, TermCriteria, Vector};
use opencv::prelude::*;
use opencv::{aruco, calib3d, imgproc};

/// Fewer corners of a ChArUco board do not hold its place.
const FEWEST: usize = 8;

/// The corners of the board in a picture, to a few hundredths of a pixel; `Err` says why it is refused.
/// Of a chessboard all must be seen, of a ChArUco board eight in two rows and columns.
pub fn find_board(
    key: &str,
    picture: &Image<u8>,
    board: &Board,
) -> Result<Result<BoardView, String>, CalibrateError> {
    let pixels = Mat::new_rows_cols_with_data(
        picture.height() as i32,
        picture.width() as i32,
        picture.as_slice(),
    )?
    .clone_pointee();
    let found = match &board.markers {
        None => chessboard(&pixels, board)?,
        Some(markers) => charuco(&pixels, board, markers)?,
    };
    Ok(found.map(|corners| BoardView { key: key.to_owned(), corners }))
}

type Corners = Vec<(usize, [f64; 2])>;

fn chessboard(picture: &Mat, board: &Board) -> Result<Result<Corners, String>, CalibrateError> {
    let pattern = CvSize::new(board.columns as i32, board.rows as i32);
    let flags = calib3d::CALIB_CB_ADAPTIVE_THRESH | calib3d::CALIB_CB_NORMALIZE_IMAGE;
    let mut corners = Vector::<Point2f>::new();
    let found = calib3d::find_chessboard_corners(picture, pattern, &mut corners, flags)?
        || calib3d::find_chessboard_corners_sb_def(picture, pattern, &mut corners)?;
    if !found || corners.len() != board.corners() {
        let (columns, rows) = (board.columns, board.rows);
        return Ok(Err(format!("no board of {columns}x{rows} inner corners found")));
    }
    refine(picture, &mut corners, board.columns)?;
    let places = corners.iter().map(|p| [f64::from(p.x), f64::from(p.y)]);
    Ok(Ok(places.enumerate().collect()))
}

/// Where the edges through each corner cross (Foerstner's operator). The window reaches to no other
/// corner.
fn refine(
    picture: &Mat,
    corners: &mut Vector<Point2f>,
    columns: usize,
) -> Result<(), CalibrateError> {
    let points = corners.to_vec();
    let apart = |a: &Point2f, b: &Point2f| (a.x - b.x).hypot(a.y - b.y);
    let along = points.chunks(columns).flat_map(|row| row.windows(2)).map(|w| apart(&w[0], &w[1]));
    let down = points.iter().zip(points.iter().skip(columns)).map(|(a, b)| apart(a, b));
    let spacing = along.chain(down).fold(f32::INFINITY, f32::min);
    let half = (0.35 * spacing).clamp(2.0, 11.0) as i32;
    let end = TermCriteria::new(3, 100, 1e-4)?;
    let (window, none) = (CvSize::new(half, half), CvSize::new(-1, -1));
    Ok(imgproc::corner_sub_pix(picture, corners, window, none, end)?)
}

fn charuco(
    picture: &Mat,
    board: &Board,
    markers: &Markers,
) -> Result<Result<Corners, String>, CalibrateError> {
    let (dictionary, printed) = charuco_board(board, markers)?;
    let mut marker_corners = Vector::<Vector<Point2f>>::new();
    let mut marker_ids = Vector::<i32>::new();
    aruco::detect_markers_def(picture, &dictionary, &mut marker_corners, &mut marker_ids)?;
    if marker_ids.is_empty() {
        return Ok(Err("no markers of the dictionary found".into()));
    }
    let (mut corners, mut ids) = (Vector::<Point2f>::new(), Vector::<i32>::new());
    aruco::interpolate_corners_charuco_def(
        &marker_corners,
        &marker_ids,
        picture,
        &printed,
        &mut corners,
        &mut ids,
    )?;
    let found: Corners = ids
        .iter()
        .zip(&corners)
        .filter_map(|(id, p)| Some((usize::try_from(id).ok()?, [f64::from(p.x), f64::from(p.y)])))
        .filter(|(id, _)| *id < board.corners())
        .collect();
    let differ = |of: fn(usize, usize) -> usize| {
        found.first().is_some_and(|(first, _)| {
            found.iter().any(|(n, _)| of(*n, board.columns) != of(*first, board.columns))
        })
    };
    let spans = differ(|n, columns| n % columns) && differ(|n, columns| n / columns);
    if found.len() < FEWEST || !spans {
        return Ok(Err(format!("{} corners between markers found: too few", found.len())));
    }
    Ok(Ok(found))
}

/// As OpenCV 4.6 and before draw it: a black square in the corner where counting starts.
fn charuco_board(
    board: &Board,
    markers: &Markers,
) -> Result<(Ptr<aruco::Dictionary>, Ptr<aruco::CharucoBoard>), CalibrateError> {
    let count = [50, 100, 250, 1000].iter().position(|&n| n == markers.count);
    let number = count.map(|count| (markers.bits.saturating_sub(4) * 4 + count) as i32);
    let number = number.ok_or(CalibrateError::Options("no such marker dictionary".into()))?;
    let dictionary = aruco::get_predefined_dictionary_i32(number)?;
    let printed = aruco::CharucoBoard::create(
        board.columns as i32 + 1,
        board.rows as i32 + 1,
        board.square_m as f32,
        markers.side_m as f32,
        &dictionary,
    )?;
    Ok((dictionary, printed))
}

/// A ChArUco board to print or to test with, `side` pixels a square and half a square of margin.
pub fn draw_charuco(board: &Board, side: usize) -> Result<Image<u8>, CalibrateError> {
    board.check()?;
    let markers = board.markers.ok_or(CalibrateError::Options("a board without markers".into()))?;
    let (_, mut printed) = charuco_board(board, &markers)?;
    let (columns, rows) = (board.columns + 2, board.rows + 2);
    let size = CvSize::new((columns * side) as i32, (rows * side) as i32);
    let mut drawn = Mat::default();
    printed.draw(size, &mut drawn, side as i32 / 2, 1)?;
    let pixels = drawn.data_bytes()?.to_vec();
    Ok(Image::from_vec(crate::image::Size::new(columns * side, rows * side), pixels))
}
