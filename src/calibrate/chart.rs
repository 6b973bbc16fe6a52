//! A colour matrix from a chart of 24 patches (ColorChecker Classic).

use super::CalibrateError;
use crate::capture::calibration::Photometry;
use crate::capture::{CaptureError, gain, linear_from_code};
use crate::image::Image;
use crate::math::color::{linear_from_srgb, luminance};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use std::path::Path;

const COLUMNS: usize = 6;
const ROWS: usize = 4;
pub const PATCHES: usize = COLUMNS * ROWS;

/// The patch whose luminance the matrix keeps: the white one.
const WHITE: usize = 18;

#[rustfmt::skip]
/// The patches, by rows.
pub const NAMES: [&str; PATCHES] = [
    "dark skin", "light skin", "blue sky", "foliage", "blue flower", "bluish green",
    "orange", "purplish blue", "moderate red", "purple", "yellow green", "orange yellow",
    "blue", "green", "red", "yellow", "magenta", "cyan",
    "white", "neutral 8", "neutral 6.5", "neutral 5", "neutral 3.5", "black",
];

#[rustfmt::skip]
/// Published sRGB codes of the ColorChecker Classic's patches, by rows from "dark skin" to "black".
pub const SRGB_CODES: [[f64; 3]; PATCHES] = [
    [115., 82., 68.], [194., 150., 130.], [98., 122., 157.], [87., 108., 67.], [133., 128., 177.], [103., 189., 170.],
    [214., 126., 44.], [80., 91., 166.], [193., 90., 99.], [94., 60., 108.], [157., 188., 64.], [224., 163., 46.],
    [56., 61., 150.], [70., 148., 73.], [175., 54., 60.], [231., 199., 31.], [187., 86., 149.], [8., 133., 161.],
    [243., 243., 242.], [200., 200., 200.], [160., 160., 160.], [122., 122., 121.], [85., 85., 85.], [52., 52., 52.],
];

/// Linear RGB of each patch; `None` where it is saturated.
pub type Patches = [Option<[f64; 3]>; PATCHES];

/// Matrix, and what it leaves.
#[derive(Clone, Debug)]
pub struct FoundMatrix {
    /// Linear sRGB from linear camera RGB; the white patch keeps its luminance.
    pub color_matrix: [[f64; 3]; 3],
    pub patches: usize,
    /// Names of those left out because a pixel of theirs is saturated.
    pub saturated: Vec<&'static str>,
    /// Mean CIE 1976 colour difference of the patches, without the matrix (scaled to the same white)
    /// and with it.
    pub delta_e_before: f64,
    pub delta_e_after: f64,
}

/// Linear light of sRGB codes, which need not be whole.
pub fn reference(codes: &[[f64; 3]; PATCHES]) -> [[f64; 3]; PATCHES] {
    codes.map(|rgb| rgb.map(|c| f64::from(linear_from_srgb((c / 255.0) as f32))))
}

/// Mean linear camera light of each patch in a picture, the middle two fifths of its sides. `corners`:
/// outer corners of the field of patches, from that of "dark skin" on clockwise by the chart's upright
/// picture ("bluish green", "black", "white").
pub fn measure_patches(
    picture: &Image<[u8; 3]>,
    corners: &[[f64; 2]; 4],
    photometry: &Photometry,
) -> Result<Patches, CalibrateError> {
    let picture_from_chart = homography(corners)?;
    let size = picture.size();
    let curves = linear_from_code(photometry);
    let mut patches = [None; PATCHES];
    const STEPS: usize = 24;
    for (number, patch) in patches.iter_mut().enumerate() {
        let (column, row) = ((number % COLUMNS) as f64, (number / COLUMNS) as f64);
        let (mut sum, mut saturated) = ([0.0; 3], false);
        for step in 0..STEPS * STEPS {
            let along = |i: usize| 0.3 + 0.4 * (i as f64 + 0.5) / STEPS as f64;
            let (u, v) = (column + along(step % STEPS), row + along(step / STEPS));
            let at = picture_from_chart * Vector3::new(u / COLUMNS as f64, v / ROWS as f64, 1.0);
            let (x, y) = ((at.x / at.z).round(), (at.y / at.z).round());
            let inside = x >= 0.0 && y >= 0.0 && x < size.width as f64 && y < size.height as f64;
            if !inside {
                let problem = format!(
                    "the patch \"{}\" reaches out of the picture: are the corners in order, from \"dark \
                     skin\" over \"bluish green\" and \"black\" to \"white\"?",
                    NAMES[number]
                );
                return Err(CalibrateError::Options(problem));
            }
            let (x, y) = (x as usize, y as usize);
            let codes = picture.row(y)[x];
            saturated |= codes.iter().any(|&c| c >= 254);
            let gain = gain(photometry, x, y, size);
            for c in 0..3 {
                sum[c] += gain * f64::from(curves[c][usize::from(codes[c])]);
            }
        }
        *patch = (!saturated).then(|| sum.map(|v| v / (STEPS * STEPS) as f64));
    }
    Ok(patches)
}

/// The projective map that takes the unit square's corners to these.
fn homography(corners: &[[f64; 2]; 4]) -> Result<Matrix3<f64>, CalibrateError> {
    let mut matrix = SMatrix::<f64, 8, 8>::zeros();
    let mut right = SVector::<f64, 8>::zeros();
    let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    for (i, ([u, v], [x, y])) in square.iter().zip(corners).enumerate() {
        let rows = [
            [*u, *v, 1.0, 0.0, 0.0, 0.0, -u * x, -v * x],
            [0.0, 0.0, 0.0, *u, *v, 1.0, -u * y, -v * y],
        ];
        for (k, row) in rows.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                matrix[(2 * i + k, j)] = *value;
            }
        }
        (right[2 * i], right[2 * i + 1]) = (*x, *y);
    }
    let solved = matrix.lu().solve(&right).filter(|h| h.iter().all(|v| v.is_finite()));
    let h = solved
        .ok_or_else(|| CalibrateError::Options("the chart's corners span no quadrangle".into()))?;
    Ok(Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0))
}

/// Codes from a CSV file: 24 lines that end in `red,green,blue` of 0 to 255. Lines without numbers at
/// their end (headings) are passed over.
pub fn read_codes(path: &Path) -> Result<[[f64; 3]; PATCHES], CalibrateError> {
    let content = crate::files::read_given_text(path).map_err(|e| CaptureError::io(path, e))?;
    let codes: Vec<[f64; 3]> = content.lines().filter_map(codes_of_line).collect();
    let count = codes.len();
    let in_range = codes.as_flattened().iter().all(|c| (0.0..=255.0).contains(c));
    codes.try_into().ok().filter(|_| in_range).ok_or_else(|| {
        let problem = format!("{count} lines of red,green,blue; {PATCHES} of 0 to 255 are needed");
        CaptureError::file(path, problem).into()
    })
}

fn codes_of_line(line: &str) -> Option<[f64; 3]> {
    let mut fields = line.rsplit(',').map(|f| f.trim().parse::<f64>());
    let (b, g, r) = (fields.next()?.ok()?, fields.next()?.ok()?, fields.next()?.ok()?);
    Some([r, g, b])
}

/// Linear camera light of codes that need not be whole, through the camera's response.
pub fn patches_from_codes(codes: &[[f64; 3]; PATCHES], photometry: &Photometry) -> Patches {
    let curves = linear_from_code(photometry);
    codes.map(|rgb| {
        let light = |c: usize| {
            let below = (rgb[c].floor() as usize).min(254);
            let [a, b] = [below, below + 1].map(|i| f64::from(curves[c][i]));
            a + (b - a) * (rgb[c] - below as f64)
        };
        (rgb.iter().all(|&c| c < 254.0)).then(|| std::array::from_fn(light))
    })
}

/// The matrix with the least squared difference over the patches in linear light.
pub fn find_matrix(
    measured: &Patches,
    reference: &[[f64; 3]; PATCHES],
) -> Result<FoundMatrix, CalibrateError> {
    let saturated: Vec<&str> =
        NAMES.into_iter().zip(measured).filter(|p| p.1.is_none()).map(|p| p.0).collect();
    let Some(white) = measured[WHITE] else {
        let problem =
            format!("saturated: {}; expose so that the white patch is not", saturated.join(", "));
        return Err(CalibrateError::Data(problem));
    };
    let luminance = |rgb: [f64; 3]| f64::from(luminance(rgb.map(|v| v as f32)));
    let scale = luminance(white) / luminance(reference[WHITE]);
    if !(scale > 1e-4 && scale.is_finite()) {
        return Err(CalibrateError::Data(
            "the white patch is black: are the corners in order?".into(),
        ));
    }
    let pairs: Vec<(Vector3<f64>, Vector3<f64>)> = measured
        .iter()
        .zip(reference)
        .filter_map(|(m, r)| m.map(|m| (Vector3::from(m), scale * Vector3::from(*r))))
        .collect();
    let mut camera = Matrix3::zeros();
    let mut cross = Matrix3::zeros();
    for (m, r) in &pairs {
        camera += m * m.transpose();
        cross += r * m.transpose();
    }
    // Values are relative to white, so a pivot this small says that colours lie in a plane.
    let spread = camera.symmetric_eigenvalues().min() / (scale * scale);
    if pairs.len() < 6 || spread < 1e-4 {
        let mut problem = format!("{} usable patches do not span the colours", pairs.len());
        if !saturated.is_empty() {
            problem += &format!("; saturated: {}", saturated.join(", "));
        }
        return Err(CalibrateError::Data(problem));
    }
    let inverse = camera.try_inverse();
    let matrix = cross * inverse.ok_or(CalibrateError::Data("no matrix is determined".into()))?;
    let white_of = |v: &Vector3<f64>| v / scale;
    let mean_error = |map: &dyn Fn(&Vector3<f64>) -> Vector3<f64>| {
        let each = pairs.iter().map(|(m, r)| delta_e(&white_of(&map(m)), &white_of(r)));
        each.sum::<f64>() / pairs.len() as f64
    };
    Ok(FoundMatrix {
        color_matrix: std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)])),
        patches: pairs.len(),
        saturated,
        delta_e_before: mean_error(&|m| *m),
        delta_e_after: mean_error(&|m| matrix * m),
    })
}

/// CIE 1976 difference of two linear sRGB colours, white being 1.
fn delta_e(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    (lab(a) - lab(b)).norm()
}

fn lab(rgb: &Vector3<f64>) -> Vector3<f64> {
    let xyz_from_srgb = Matrix3::new(
        0.412_456, 0.357_576, 0.180_437, 0.212_673, 0.715_152, 0.072_175, 0.019_334, 0.119_192,
        0.950_304,
    );
    let xyz = xyz_from_srgb * rgb;
    let white = xyz_from_srgb * Vector3::repeat(1.0);
    let f = |i: usize| {
        let t = xyz[i] / white[i];
        if t > 0.008_856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 }
    };
    let [x, y, z] = [f(0), f(1), f(2)];
    Vector3::new(116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Size;
    use crate::math::color::srgb8_from_linear;
    use crate::math::random::Rng;

    /// Rows that keep white, as after a camera's white balance.
    fn camera_from_srgb() -> Matrix3<f64> {
        Matrix3::new(0.72, 0.2, 0.08, 0.12, 0.76, 0.12, 0.03, 0.25, 0.72)
    }

    /// A chart seen from the side by a camera of other primaries, with noise.
    fn picture(corners: &[[f64; 2]; 4]) -> Image<[u8; 3]> {
        let mut rng = Rng::new(&[3]);
        let chart_from_picture = homography(corners).unwrap().try_inverse().unwrap();
        let light = reference(&SRGB_CODES);
        let size = Size::new(320, 240);
        let mut picture = Image::new(size, [0u8; 3]);
        for (x, y) in (0..size.pixels()).map(|i| (i % size.width, i / size.width)) {
            let at = chart_from_picture * Vector3::new(x as f64, y as f64, 1.0);
            let (u, v) = (6.0 * at.x / at.z, 4.0 * at.y / at.z);
            // Black between the patches.
            let gap = |t: f64| !(0.08..0.92).contains(&t.rem_euclid(1.0));
            let inside = (0.0..6.0).contains(&u) && (0.0..4.0).contains(&v) && !gap(u) && !gap(v);
            let patch = if inside { light[v as usize * 6 + u as usize] } else { [0.01; 3] };
            let seen = 0.8 * camera_from_srgb() * Vector3::from(patch);
            picture.row_mut(y)[x] = std::array::from_fn(|c| {
                srgb8_from_linear((seen[c] * (1.0 + 0.02 * f64::from(rng.normal()))) as f32)
            });
        }
        picture
    }

    #[test]
    fn the_matrix_is_found_from_four_corners() {
        let corners = [[40.0, 30.0], [290.0, 50.0], [270.0, 215.0], [55.0, 200.0]];
        let patches =
            measure_patches(&picture(&corners), &corners, &Photometry::default()).unwrap();
        let found = find_matrix(&patches, &reference(&SRGB_CODES)).unwrap();
        let truth = camera_from_srgb().try_inverse().unwrap();
        let error = Matrix3::from_fn(|i, j| found.color_matrix[i][j]) - truth;
        println!(
            "matrix error {:.4}, dE {:.2} -> {:.2}",
            error.amax(),
            found.delta_e_before,
            found.delta_e_after
        );
        // 2 % of noise over the 270 pixels of a patch are 0.12 % of its light, 4e-4 of a mean patch; the
        // inverse's rows take 1.6 of that, and the smallest singular value of the 24 patches is 0.2: 3e-3 is
        // one standard deviation, and largest of nine elements is asked for.
        assert!(error.amax() < 0.01, "{error}");
        assert!(found.patches == PATCHES && found.saturated.is_empty());
        assert!(found.delta_e_after < 0.5 && found.delta_e_before > 5.0, "{found:?}");
    }

    #[test]
    fn what_cannot_be_a_chart_is_refused() {
        let picture = Image::new(Size::new(64, 64), [255u8; 3]);
        let line = [[0.0, 0.0], [10.0, 10.0], [20.0, 20.0], [30.0, 30.0]];
        assert!(measure_patches(&picture, &line, &Photometry::default()).is_err());
        let out = [[0.0, 0.0], [100.0, 0.0], [100.0, 60.0], [0.0, 60.0]];
        assert!(measure_patches(&picture, &out, &Photometry::default()).is_err());
        let square = [[0.0, 0.0], [60.0, 0.0], [60.0, 60.0], [0.0, 60.0]];
        let white = measure_patches(&picture, &square, &Photometry::default()).unwrap();
        assert!(find_matrix(&white, &reference(&SRGB_CODES)).is_err());
        let grey = [Some([0.5; 3]); PATCHES];
        assert!(find_matrix(&grey, &reference(&SRGB_CODES)).is_err());
    }

    #[test]
    fn saturated_patches_are_named_and_left_out() {
        let corners = [[40.0, 30.0], [290.0, 50.0], [270.0, 215.0], [55.0, 200.0]];
        let light = reference(&SRGB_CODES);
        let mut picture = picture(&corners);
        let measured = |picture: &Image<[u8; 3]>| {
            measure_patches(picture, &corners, &Photometry::default()).unwrap()
        };
        // A glint on "yellow".
        let at = homography(&corners).unwrap() * Vector3::new(3.5 / 6.0, 2.5 / 4.0, 1.0);
        let (x, y) = ((at.x / at.z) as usize, (at.y / at.z) as usize);
        picture.row_mut(y)[x..x + 2].fill([255; 3]);
        let found = find_matrix(&measured(&picture), &light).unwrap();
        assert_eq!((found.patches, &found.saturated[..]), (PATCHES - 1, &["yellow"][..]));
        let truth = camera_from_srgb().try_inverse().unwrap();
        let error = Matrix3::from_fn(|i, j| found.color_matrix[i][j]) - truth;
        assert!(error.amax() < 0.01, "{error}");
        let bright = |p: &[u8; 3]| p.map(|c| c.saturating_mul(2));
        let size = picture.size();
        let over = Image::from_vec(size, picture.as_slice().iter().map(bright).collect());
        let refused = find_matrix(&measured(&over), &light).unwrap_err().to_string();
        assert!(refused.contains("saturated: ") && refused.contains("white"), "{refused}");
    }
}
