//! Where to put the volume when its place was not given.

use crate::capture::RgbdFrame;
use crate::image::Image;
use crate::math::View;
use glam::{Vec2, Vec3};

/// Every n-th pixel in x and y is looked at.
const STRIDE: usize = 4;
/// Share of depths that may be outliers in front of everything.
const OUTLIERS: f32 = 0.02;
/// Fewer depths say nothing about the scene.
const FEWEST: usize = 16;
/// Free space kept between the cube's sphere and the nearest surface, as a share of the side.
const MARGIN: f32 = 0.05;

/// Centre of a cube of `side_m` for the scene that the first frame shows, in world coordinates;
/// `None` where almost no depth is there.
///
/// Along the view axis the cube starts just before the nearest depth (the 2 % nearest are taken
/// for outliers), or earlier where the median depth within its reach would lie beyond its centre
/// otherwise: a lone wall passes through the middle, a deep room is cut behind. Across, the
/// centre is the median position of what is seen within reach. The sphere inside the cube is
/// used as its extent, as the cube is aligned with the world and not with the view.
pub fn place_centre(frame: &RgbdFrame, view: &View, side_m: f32) -> Option<Vec3> {
    if frame.depth_m.size() != view.size() || !(side_m > 0.0 && side_m.is_finite()) {
        return None;
    }
    let mut points = seen_points(&frame.depth_m, view, STRIDE);
    if points.len() < FEWEST {
        // A small picture, or one whose holes lie in step with what was looked at.
        points = seen_points(&frame.depth_m, view, 1);
    }
    if points.len() < FEWEST {
        return None;
    }
    points.sort_by(|a, b| a.z.total_cmp(&b.z));
    let near = points[(points.len() as f32 * OUTLIERS) as usize].z;
    points.retain(|p| p.z <= near + (1.0 - MARGIN) * side_m);
    let middle = near + (0.5 - MARGIN) * side_m;
    let depth = median(points.iter().map(|p| p.z)).min(middle);
    let centre =
        Vec3::new(median(points.iter().map(|p| p.x)), median(points.iter().map(|p| p.y)), depth);
    let centre = view.world_from_view_f32().transform_point3(centre);
    centre.is_finite().then_some(centre)
}

/// In view axes.
fn seen_points(depth_m: &Image<f32>, view: &View, stride: usize) -> Vec<Vec3> {
    let mut points = Vec::new();
    for y in (0..depth_m.height()).step_by(stride) {
        for (x, &depth) in depth_m.row(y).iter().enumerate().step_by(stride) {
            if depth > 0.0 && depth.is_finite() {
                points.push(view.unproject(Vec2::new(x as f32, y as f32), depth));
            }
        }
    }
    points
}

/// Upper median of at least one value.
fn median(values: impl Iterator<Item = f32>) -> f32 {
    let mut values: Vec<f32> = values.collect();
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Size;
    use crate::math::{Pinhole, Pose};

    fn frame(depth: impl Fn(usize, usize) -> f32) -> (RgbdFrame, View) {
        let camera = Pinhole { width: 160, height: 120, fx: 130.0, fy: 130.0, cx: 79.5, cy: 59.5 };
        let mut depth_m = Image::new(Size::new(160, 120), 0.0);
        for y in 0..120 {
            for x in 0..160 {
                depth_m[(x, y)] = depth(x, y);
            }
        }
        let frame = RgbdFrame { depth_m, ..RgbdFrame::default() };
        (frame, View::perspective(camera, Pose::translation(1.0, 2.0, 3.0)))
    }

    #[test]
    fn a_wall_passes_through_the_middle() {
        let (frame, view) = frame(|_, _| 1.5);
        let centre = place_centre(&frame, &view, 2.0).unwrap();
        // columns looked at are 0, 4, .. 156: their median is column 80, half a pixel off centre
        assert!((centre - Vec3::new(1.0, 2.0, 4.5)).length() < 0.02, "{centre}");
    }

    #[test]
    fn a_deep_room_starts_at_its_nearest_surface() {
        // less at 1 m than at 2.5 m, and the rest out of reach; one outlier in front
        let (frame, view) = frame(|x, y| match (x, y) {
            (0, 0) => 0.2,
            (..48, _) => 1.0,
            (..108, _) => 2.5,
            _ => 6.0,
        });
        let centre = place_centre(&frame, &view, 2.0).unwrap();
        assert!((centre.z - 3.0 - 1.9).abs() < 1e-5, "{centre}");
        // what lies within reach is seen left of the middle
        assert!(centre.x < 1.0, "{centre}");
    }

    #[test]
    fn holes_in_step_with_what_is_looked_at_hide_no_wall() {
        let (frame, view) = frame(|x, y| if (x + y) % 2 == 1 { 1.5 } else { 0.0 });
        let centre = place_centre(&frame, &view, 2.0).unwrap();
        assert!((centre - Vec3::new(1.0, 2.0, 4.5)).length() < 0.02, "{centre}");
    }

    #[test]
    fn no_depth_has_no_place() {
        let (frame, view) = frame(|_, _| 0.0);
        assert!(place_centre(&frame, &view, 2.0).is_none());
    }
}
