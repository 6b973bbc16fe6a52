//! Boards in pictures.

use super::CalibrateError;
use super::board::{Board, BoardView, Markers};
use super::crossing::{Around, crossing};
use crate::image::Image;
use opencv::core::{Mat, Point2f, Ptr, Size as CvSize, Vector};
use opencv::prelude::*;
use opencv::{aruco, calib3d};

/// Fewer corners of a ChArUco board do not hold its place.
const FEWEST: usize = 8;

/// The corners of the board in a picture, to a few hundredths of a pixel; `Err` says why it is refused.
/// Of a chessboard all must be seen, of a ChArUco board eight in two rows and columns.
pub fn find_board(
    key: &str,
    picture: &Image<u8>,
    board: &Board,
) -> Result<Result<BoardView, String>, CalibrateError> {
    let pixels = matrix(picture)?;
    let found = match &board.markers {
        None => chessboard(&pixels, board)?,
        Some(markers) => charuco(&pixels, board, markers)?,
    };
    Ok(found.and_then(|rough| {
        let corners = refine(picture, &rough, board);
        // All corners of a chessboard were found: where most edges are sharp, the others are only blurred.
        let most = if board.markers.is_some() { 0 } else { board.corners() / 2 };
        let needed = FEWEST.max(most).min(board.corners());
        if corners.len() < needed {
            let (found, sharp) = (rough.len(), corners.len());
            return Err(format!(
                "{found} corners found, but the edges cross sharply at {sharp} only: is the board \
                 blurred, too far or at the picture's edge?"
            ));
        }
        Ok(BoardView { key: key.to_owned(), corners })
    }))
}

fn matrix(picture: &Image<u8>) -> Result<Mat, CalibrateError> {
    let (rows, columns) = (picture.height() as i32, picture.width() as i32);
    Ok(Mat::new_rows_cols_with_data(rows, columns, picture.as_slice())?.clone_pointee())
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
    let places = corners.iter().map(|p| [f64::from(p.x), f64::from(p.y)]);
    Ok(Ok(places.enumerate().collect()))
}

/// Corners to hundredths of a pixel. Those without a neighbour along the board and one across, which say
/// how its squares lie, are left out, as are those whose edges do not cross.
fn refine(picture: &Image<u8>, corners: &Corners, board: &Board) -> Corners {
    let mut places = vec![None; board.corners()];
    for &(number, place) in corners {
        places[number] = Some(place);
    }
    let clear = board.markers.map_or(f64::INFINITY, |m| 0.5 * (1.0 - m.side_m / board.square_m));
    let side = |number: usize, [x, y]: [f64; 2], index: usize, count: usize, step: usize| {
        let to = |other: Option<[f64; 2]>| other.map(|[a, b]| [a - x, b - y]);
        let after = (index + 1 < count).then(|| to(places[number + step])).flatten();
        let before = (index > 0).then(|| to(places[number - step])).flatten();
        match (before.map(|[a, b]| [-a, -b]), after) {
            (Some([a, b]), Some([c, d])) => Some([0.5 * (a + c), 0.5 * (b + d)]),
            (one, other) => one.or(other),
        }
    };
    let refined = |&(number, at): &(usize, [f64; 2])| {
        let (column, row) = (number % board.columns, number / board.columns);
        let along = side(number, at, column, board.columns, 1)?;
        let down = side(number, at, row, board.rows, board.columns)?;
        Some((number, crossing(picture, &Around { at, along, down, clear })?))
    };
    corners.iter().filter_map(refined).collect()
}

/// How many inner corners the chessboard in a picture has, when not what was looked for: up to two more or
/// fewer each way.
pub fn other_size(
    picture: &Image<u8>,
    board: &Board,
) -> Result<Option<(usize, usize)>, CalibrateError> {
    let pixels = matrix(picture)?;
    let near = |n: usize| n.saturating_sub(2).max(3)..=n + 2;
    let mut sizes: Vec<(usize, usize)> =
        near(board.columns).flat_map(|c| near(board.rows).map(move |r| (c, r))).collect();
    sizes.retain(|&size| size != (board.columns, board.rows));
    // The largest first: a part of a board is a board, too.
    sizes.sort_by_key(|(c, r)| std::cmp::Reverse(c * r));
    let flags = calib3d::CALIB_CB_ADAPTIVE_THRESH
        | calib3d::CALIB_CB_NORMALIZE_IMAGE
        | calib3d::CALIB_CB_FAST_CHECK;
    for (columns, rows) in sizes {
        let pattern = CvSize::new(columns as i32, rows as i32);
        let mut corners = Vector::<Point2f>::new();
        if calib3d::find_chessboard_corners(&pixels, pattern, &mut corners, flags)? {
            return Ok(Some((columns, rows)));
        }
    }
    Ok(None)
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
