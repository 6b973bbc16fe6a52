//! Small pictures of places where the camera has been, to find the way back when it is lost.

use crate::capture::RgbdFrame;
use crate::image::Image;
use crate::math::Pose;

pub(crate) const COLUMNS: usize = 40;
pub(crate) const ROWS: usize = 30;
const CELLS: usize = COLUMNS * ROWS;

/// A new keyframe is kept where the camera is this far from all others.
const SPACING_M: f64 = 0.15;
const SPACING_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;

/// Beyond this many the most redundant one makes room: 256 of them cover a room.
const CAPACITY: usize = 256;

/// Depth differences count up to this; more is simply another place.
const DEPTH_CAP_M: f32 = 0.5;

/// A cell has depth where more than this share of its pixels has.
pub(crate) const MIN_CELL_DEPTH: f32 = 0.5;

/// Two views that share less of their depth than this are not compared by depth.
const MIN_SHARED_DEPTH: f32 = 0.25;

/// Intensity, blurred and normalised to mean 0 and variance 1 (so exposure does not matter), and depth in
/// metres, missing = 0.0.
#[derive(Clone, Debug)]
pub(crate) struct Thumbnail {
    pub intensity: Vec<f32>,
    pub depth_m: Vec<f32>,
}

#[derive(Clone, Debug)]
struct Keyframe {
    thumbnail: Thumbnail,
    world_from_camera: Pose,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Keyframes {
    frames: Vec<Keyframe>,
}

impl Thumbnail {
    pub fn new(frame: &RgbdFrame) -> Self {
        let intensity = cells(&frame.intensity, |v| v.is_finite(), 0.0);
        let depth_m = cells(&frame.depth_m, |d| d.is_finite() && d > 0.0, MIN_CELL_DEPTH);
        Self::from_cells(&intensity, depth_m)
    }

    /// From means of intensity and depth over [`COLUMNS`] x [`ROWS`] cells of the frame.
    pub fn from_cells(intensity: &[f32], depth_m: Vec<f32>) -> Self {
        Self { intensity: normalised(blurred(intensity)), depth_m }
    }

    /// 0 for the same picture; up to 2 (one from intensity, one from depth).
    fn distance(&self, other: &Self) -> f32 {
        let correlation: f32 =
            self.intensity.iter().zip(&other.intensity).map(|(a, b)| a * b).sum::<f32>()
                / CELLS as f32;
        let (mut difference, mut shared) = (0.0, 0.0);
        for (&a, &b) in self.depth_m.iter().zip(&other.depth_m) {
            if a > 0.0 && b > 0.0 {
                difference += (a - b).abs().min(DEPTH_CAP_M) / DEPTH_CAP_M;
                shared += 1.0;
            }
        }
        let enough = shared >= MIN_SHARED_DEPTH * CELLS as f32;
        let depth = if enough { difference / shared } else { 1.0 };
        0.5 * (1.0 - correlation) + depth
    }
}

impl Keyframes {
    pub fn clear(&mut self) {
        self.frames.clear();
    }

    /// Whether one was taken from near this pose.
    pub fn has_near(&self, world_from_camera: &Pose) -> bool {
        self.frames.iter().any(|k| separation(&k.world_from_camera, world_from_camera) < 1.0)
    }

    pub fn keep(&mut self, thumbnail: Thumbnail, world_from_camera: Pose) {
        if self.frames.len() >= CAPACITY {
            self.drop_most_redundant();
        }
        self.frames.push(Keyframe { thumbnail, world_from_camera });
    }

    /// Poses of the `count` most similar keyframes, the best first.
    pub fn most_similar(&self, thumbnail: &Thumbnail, count: usize) -> Vec<Pose> {
        let mut ranked: Vec<_> = self
            .frames
            .iter()
            .map(|k| (k.thumbnail.distance(thumbnail), k.world_from_camera))
            .collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked.into_iter().take(count).map(|(_, pose)| pose).collect()
    }

    /// Of the two keyframes nearest to each other the older goes.
    fn drop_most_redundant(&mut self) {
        let mut nearest = (f64::INFINITY, 0);
        for (i, a) in self.frames.iter().enumerate() {
            for b in &self.frames[i + 1..] {
                let separation = separation(&a.world_from_camera, &b.world_from_camera);
                if separation < nearest.0 {
                    nearest = (separation, i);
                }
            }
        }
        self.frames.remove(nearest.1);
    }
}

/// Distance of two poses in units of the keyframes' spacing.
fn separation(a: &Pose, b: &Pose) -> f64 {
    let metres = (a.translation.vector - b.translation.vector).norm();
    (metres / SPACING_M).max(a.rotation.angle_to(&b.rotation) / SPACING_RAD)
}

/// Mean of the valid pixels of each cell; 0.0 where fewer than `min_share` of its pixels are valid.
/// An image without pixels (no intensity delivered) gives zeros.
fn cells(image: &Image<f32>, valid: impl Fn(f32) -> bool, min_share: f32) -> Vec<f32> {
    let (width, height) = (image.width(), image.height());
    let mut out = vec![0.0; CELLS];
    if width == 0 || height == 0 {
        return out;
    }
    let span = |i: usize, of: usize, size: usize| {
        let first = i * size / of;
        first..((i + 1) * size / of).max(first + 1)
    };
    for (cell, out) in out.iter_mut().enumerate() {
        let (mut sum, mut count, mut all) = (0.0, 0.0, 0.0);
        for y in span(cell / COLUMNS, ROWS, height) {
            for &value in &image.row(y)[span(cell % COLUMNS, COLUMNS, width)] {
                all += 1.0;
                if valid(value) {
                    sum += value;
                    count += 1.0;
                }
            }
        }
        if count > min_share * all {
            *out = sum / count;
        }
    }
    out
}

/// Binomial 3x3, borders repeated: tolerates a shift of a cell.
fn blurred(cells: &[f32]) -> Vec<f32> {
    let at = |x: usize, y: usize| cells[y * COLUMNS + x];
    let mut out = Vec::with_capacity(CELLS);
    for y in 0..ROWS {
        let rows = [y.saturating_sub(1), y, y, (y + 1).min(ROWS - 1)];
        for x in 0..COLUMNS {
            let columns = [x.saturating_sub(1), x, x, (x + 1).min(COLUMNS - 1)];
            let sum: f32 = rows.iter().flat_map(|&y| columns.map(|x| at(x, y))).sum();
            out.push(sum / 16.0);
        }
    }
    out
}

/// Mean 0, variance 1; all zero where the picture is flat.
fn normalised(mut cells: Vec<f32>) -> Vec<f32> {
    let mean = cells.iter().sum::<f32>() / CELLS as f32;
    let variance = cells.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / CELLS as f32;
    // A hundredth of an 8-bit step: nothing to be seen.
    let scale = if variance > 1e-4 { 1.0 / variance.sqrt() } else { 0.0 };
    for value in &mut cells {
        *value = (*value - mean) * scale;
    }
    cells
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Size;
    use nalgebra::Vector3;

    fn frame(phase: f32, gain: f32) -> RgbdFrame {
        let size = Size::new(67, 43);
        let pixels = (0..size.pixels()).map(|i| {
            let (x, y) = ((i % 67) as f32, (i / 67) as f32);
            (
                (x * 0.11 + phase).sin() + (y * 0.17 - phase).cos(),
                1.5 + 0.3 * (x * 0.05 + phase).sin(),
            )
        });
        let (intensity, depth): (Vec<_>, Vec<_>) =
            pixels.map(|(i, d)| (gain * (100.0 + 40.0 * i), d)).unzip();
        RgbdFrame {
            intensity: Image::from_vec(size, intensity),
            depth_m: Image::from_vec(size, depth),
            ..Default::default()
        }
    }

    fn at(x: f64) -> Pose {
        Pose::new(Vector3::new(x, 0.0, 0.0), Vector3::zeros())
    }

    #[test]
    fn finds_the_place_in_spite_of_another_exposure() {
        let mut keyframes = Keyframes::default();
        for i in 0..6 {
            keyframes.keep(Thumbnail::new(&frame(i as f32, 1.0)), at(f64::from(i)));
        }
        for i in 0..6 {
            let thumbnail = Thumbnail::new(&frame(i as f32 + 0.1, 0.6));
            let found = keyframes.most_similar(&thumbnail, 2);
            assert_eq!(found.len(), 2);
            assert_eq!(found[0], at(f64::from(i)));
        }
    }

    #[test]
    fn near_poses_are_known_and_the_number_is_bounded() {
        let mut keyframes = Keyframes::default();
        let one = Thumbnail::new(&frame(0.0, 1.0));
        keyframes.keep(one.clone(), at(0.0));
        assert!(keyframes.has_near(&at(0.14)) && !keyframes.has_near(&at(0.16)));
        let turned = |degrees: f64| {
            Pose::new(Vector3::zeros(), Vector3::new(0.0, degrees.to_radians(), 0.0))
        };
        assert!(keyframes.has_near(&turned(9.0)) && !keyframes.has_near(&turned(11.0)));
        for i in 1..CAPACITY + 20 {
            keyframes.keep(one.clone(), at(0.2 * i as f64));
        }
        assert_eq!(keyframes.frames.len(), CAPACITY);
    }

    #[test]
    fn empty_and_broken_pictures_have_a_finite_distance() {
        let mut broken = frame(0.0, 1.0);
        broken.intensity.fill(f32::NAN);
        broken.depth_m.fill(f32::INFINITY);
        let thumbnails =
            [RgbdFrame::default(), broken, frame(0.0, 1.0)].map(|f| Thumbnail::new(&f));
        for a in &thumbnails {
            for b in &thumbnails {
                // the correlation is rounded
                assert!((-1e-5..=2.0).contains(&a.distance(b)));
            }
        }
    }
}
