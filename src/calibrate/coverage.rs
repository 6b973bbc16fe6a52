//! A picture of where corners were seen and how far off they are.

use super::board::BoardView;
use crate::image::{Image, Size};

const BACKGROUND: [u8; 3] = [24, 24, 28];
/// Cells of the coverage grid along the width; rows follow the shape of the picture.
const CELLS: usize = 8;

/// Corners of one view, and what the camera model leaves of them.
pub struct SeenView<'a> {
    pub view: &'a BoardView,
    pub residuals: &'a [[f64; 2]],
    /// Not part of the solution.
    pub refused: bool,
}

/// The picture, and what it shows in numbers.
#[derive(Clone, Debug)]
pub struct Coverage {
    pub picture: Image<[u8; 3]>,
    /// Share of cells with a corner of a used view.
    pub share: f64,
    /// The same of the quarters of the picture: upper left and right, lower left and right.
    pub quarters: [f64; 4],
    /// Pixels of the picture a pixel of residual is drawn as.
    pub magnification: f64,
}

impl Coverage {
    /// What to tell a user whose boards leave much of the picture empty.
    pub fn warning(&self) -> Option<String> {
        const NAMES: [&str; 4] = ["upper left", "upper right", "lower left", "lower right"];
        let empty: Vec<&str> =
            NAMES.into_iter().zip(self.quarters).filter(|q| q.1 == 0.0).map(|q| q.0).collect();
        let none = match empty.as_slice() {
            [] if self.share >= 0.5 => return None,
            [] => String::new(),
            [one] => format!(", none in the {one} quarter"),
            several => format!(", none in the quarters {}", several.join(", ")),
        };
        let share = 100.0 * self.share;
        Some(format!(
            "corners in {share:.0} % of the picture{none}; where there are none, the lens is a guess"
        ))
    }
}

/// Cells are the brighter the more corners they hold. Corners are green, over yellow to red at three
/// times the RMS residual, with magnified residuals; those of refused views are grey.
pub fn draw_coverage(size: Size, views: &[SeenView]) -> Coverage {
    let rows = (CELLS * size.height).div_ceil(size.width.max(1)).max(1);
    let mut counts = vec![0usize; CELLS * rows];
    let used = || views.iter().filter(|v| !v.refused);
    for [x, y] in used().flat_map(|v| v.view.corners.iter().map(|c| c.1)) {
        let cell = |v: f64, side: usize, cells: usize| {
            ((v.max(0.0) / side as f64 * cells as f64) as usize).min(cells - 1)
        };
        counts[cell(y, size.height, rows) * CELLS + cell(x, size.width, CELLS)] += 1;
    }
    let most = counts.iter().copied().max().unwrap_or(0).max(1);
    let mut picture = Image::new(size, BACKGROUND);
    for y in 0..size.height {
        for (x, pixel) in picture.row_mut(y).iter_mut().enumerate() {
            let cell = (y * rows / size.height) * CELLS + x * CELLS / size.width;
            let light = 60.0 * (counts[cell] as f64 / most as f64).sqrt();
            *pixel = BACKGROUND.map(|b| b + light as u8);
        }
    }
    let all: Vec<[f64; 2]> = used().flat_map(|v| v.residuals.iter().copied()).collect();
    let rms = super::board::rms(&all).max(1e-6);
    let magnification = (0.02 * size.width as f64 / rms).clamp(1.0, 1000.0);
    for view in views {
        for (&(_, place), &residual) in view.view.corners.iter().zip(view.residuals) {
            let color = if view.refused { [90; 3] } else { heat(residual, 3.0 * rms) };
            let end = [0, 1].map(|i| place[i] + magnification * residual[i]);
            if !view.refused {
                line(&mut picture, place, end, color);
            }
            dot(&mut picture, place, color);
        }
    }
    let share = counts.iter().filter(|&&c| c > 0).count() as f64 / counts.len() as f64;
    let quarters = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(right, low)| {
        let of_quarter = |i: &usize| {
            usize::from(i % CELLS >= CELLS / 2) == right
                && usize::from(2 * (i / CELLS) >= rows) == low
        };
        let cells: Vec<usize> = (0..counts.len()).filter(of_quarter).collect();
        let full = cells.iter().filter(|&&i| counts[i] > 0).count();
        full as f64 / cells.len().max(1) as f64
    });
    Coverage { picture, share, quarters, magnification }
}

fn heat([x, y]: [f64; 2], hot: f64) -> [u8; 3] {
    let t = (x.hypot(y) / hot).clamp(0.0, 1.0);
    [(255.0 * (2.0 * t).min(1.0)) as u8, (255.0 * (2.0 - 2.0 * t).min(1.0)) as u8, 40]
}

fn dot(picture: &mut Image<[u8; 3]>, [x, y]: [f64; 2], color: [u8; 3]) {
    for dy in -1..=1 {
        for dx in -1..=1 {
            set(picture, x + f64::from(dx), y + f64::from(dy), color);
        }
    }
}

fn line(picture: &mut Image<[u8; 3]>, from: [f64; 2], to: [f64; 2], color: [u8; 3]) {
    let length = (to[0] - from[0]).hypot(to[1] - from[1]);
    // A residual without bound (a corner behind the camera) is drawn as a stub.
    let steps = if length.is_finite() { length.min(4000.0) as usize } else { 0 };
    for i in 0..=steps {
        let t = i as f64 / steps.max(1) as f64;
        let at = |k: usize| if steps == 0 { from[k] } else { from[k] + t * (to[k] - from[k]) };
        set(picture, at(0), at(1), color);
    }
}

fn set(picture: &mut Image<[u8; 3]>, x: f64, y: f64, color: [u8; 3]) {
    let (x, y) = (x.round(), y.round());
    if x >= 0.0 && y >= 0.0 && x < picture.width() as f64 && y < picture.height() as f64 {
        picture.row_mut(y as usize)[x as usize] = color;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_count_once_and_refused_ones_not_at_all() {
        let view = |x: f64| BoardView { key: "a".into(), corners: vec![(0, [x, 10.0])] };
        let (used, refused) = (view(4.0), view(60.0));
        let residuals = [[0.1, 0.0]];
        let views = [
            SeenView { view: &used, residuals: &residuals, refused: false },
            SeenView { view: &refused, residuals: &residuals, refused: true },
        ];
        let coverage = draw_coverage(Size::new(64, 48), &views);
        assert_eq!(coverage.share, 1.0 / 48.0);
        assert_eq!(coverage.quarters, [1.0 / 12.0, 0.0, 0.0, 0.0]);
        let warning = coverage.warning().unwrap();
        assert!(warning.contains("quarters upper right, lower left, lower right"), "{warning}");
        let full = Coverage { share: 0.6, quarters: [0.6; 4], ..coverage.clone() };
        assert_eq!(full.warning(), None);
        let other = |x: usize| coverage.picture.row(10)[x];
        assert!(other(4)[1] > 200, "green where the residual is small");
        assert_eq!(other(60), [90; 3]);
        // 2 % of 64 pixels
        assert!((coverage.magnification - 12.8).abs() < 1e-9);
        draw_coverage(Size::new(1, 1), &[]);
    }
}
