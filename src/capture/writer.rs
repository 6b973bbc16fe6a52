//! Writes recordings in the TUM RGB-D layout: `rgb/`, `depth/`, `rgb.txt`, `depth.txt`,
//! `associations.txt`, `groundtruth.txt`, `intrinsics.txt`.
//!
//! A picture is written under a temporary name and renamed, and its line is added to the list only
//! then: whenever the program stops, the folder is a valid recording of the frames so far.

use super::CaptureError;
use crate::image::Image;
use crate::math::{Pinhole, Pose};
use crate::output::{OutputError, atomic_write};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageResult};
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

/// 16-bit depth steps per metre.
pub const DEPTH_SCALE: f32 = 5000.0;

/// How colour pictures are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ColorFormat {
    #[default]
    Png,
    /// Quality 1 to 100.
    Jpeg(u8),
}

impl ColorFormat {
    pub fn extension(self) -> &'static str {
        match self {
            ColorFormat::Png => "png",
            ColorFormat::Jpeg(_) => "jpg",
        }
    }

    /// The picture as a file's bytes.
    pub fn encode(self, picture: &Image<[u8; 3]>) -> ImageResult<Vec<u8>> {
        let (bytes, mut out) = (picture.as_slice().as_flattened(), Vec::new());
        let (width, height) = (picture.width() as u32, picture.height() as u32);
        match self {
            ColorFormat::Png => {
                PngEncoder::new_with_quality(&mut out, CompressionType::Fast, FilterType::Adaptive)
                    .write_image(bytes, width, height, ExtendedColorType::Rgb8)?;
            }
            ColorFormat::Jpeg(quality) => {
                JpegEncoder::new_with_quality(&mut out, quality.clamp(1, 100)).write_image(
                    bytes,
                    width,
                    height,
                    ExtendedColorType::Rgb8,
                )?;
            }
        }
        Ok(out)
    }
}

/// Speed against size of depth pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthCompression {
    /// For live recording.
    #[default]
    Fast,
    Small,
}

/// Metres to 16-bit steps; what is missing, broken or beyond 13 m becomes 0.
pub fn depth_steps(depth_m: f32) -> u16 {
    let steps = (depth_m * DEPTH_SCALE).round();
    if steps >= 0.0 && steps <= f32::from(u16::MAX) { steps as u16 } else { 0 }
}

/// A 16-bit grey PNG of a depth picture.
pub fn encode_depth(depth_m: &Image<f32>, compression: DepthCompression) -> ImageResult<Vec<u8>> {
    let bytes: Vec<u8> =
        depth_m.as_slice().iter().flat_map(|&d| depth_steps(d).to_ne_bytes()).collect();
    match compression {
        DepthCompression::Fast => {
            grey_png(depth_m, &bytes, CompressionType::Fast, FilterType::Adaptive)
        }
        DepthCompression::Small => {
            // Smooth depth is smallest with filters, noisy depth of few distinct steps without.
            let filtered = grey_png(depth_m, &bytes, CompressionType::Best, FilterType::Adaptive)?;
            let plain = grey_png(depth_m, &bytes, CompressionType::Best, FilterType::NoFilter)?;
            Ok(if plain.len() < filtered.len() { plain } else { filtered })
        }
    }
}

fn grey_png(
    depth_m: &Image<f32>,
    bytes: &[u8],
    level: CompressionType,
    filter: FilterType,
) -> ImageResult<Vec<u8>> {
    let (width, height) = (depth_m.width() as u32, depth_m.height() as u32);
    let mut out = Vec::new();
    PngEncoder::new_with_quality(&mut out, level, filter).write_image(
        bytes,
        width,
        height,
        ExtendedColorType::L16,
    )?;
    Ok(out)
}

/// Writes to a temporary name beside `path`, then renames: readers see all of the file or none.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), CaptureError> {
    atomic_write(path, |out| out.write_all(bytes)).map_err(|error| match error {
        OutputError::Io { path, source } => CaptureError::Io { path, source },
        // These name the path themselves.
        other => CaptureError::Sequence(other.to_string()),
    })
}

fn io_error(path: &Path, source: std::io::Error) -> CaptureError {
    CaptureError::Io { path: path.display().to_string(), source }
}

fn image_error(path: &Path, source: image::ImageError) -> CaptureError {
    CaptureError::File { path: path.display().to_string(), problem: source.to_string() }
}

/// A recording being written.
#[derive(Debug)]
pub struct TumWriter {
    folder: PathBuf,
    camera: Pinhole,
    color_format: ColorFormat,
    depth_compression: DepthCompression,
    rgb: List,
    depth: List,
    associations: List,
    /// Made with the first frame that has a pose.
    poses: Option<List>,
    /// A second depth picture a frame, in a folder of its own.
    second_depth: Option<(String, List)>,
    frames: usize,
}

/// What one frame of a recording consists of; pictures have the camera's size.
#[derive(Clone, Copy, Debug)]
pub struct FrameRef<'a> {
    pub timestamp_s: f64,
    /// 8-bit sRGB.
    pub color: &'a Image<[u8; 3]>,
    /// z-depth in metres; missing = 0.0.
    pub depth_m: &'a Image<f32>,
    /// For the folder given to [`TumWriter::with_second_depth`].
    pub second_depth_m: Option<&'a Image<f32>>,
    pub world_from_camera: Option<&'a Pose>,
}

impl TumWriter {
    /// Starts a recording in `folder`, which is made where it is missing.
    ///
    /// # Errors
    /// The folder holds a recording already, or cannot be written.
    pub fn create(
        folder: &Path,
        camera: Pinhole,
        color_format: ColorFormat,
        depth_compression: DepthCompression,
    ) -> Result<Self, CaptureError> {
        if folder.join("rgb.txt").exists() {
            let folder = folder.display();
            return Err(CaptureError::Sequence(format!(
                "{folder} holds a recording already: remove it, or choose another folder"
            )));
        }
        for name in ["rgb", "depth"] {
            let path = folder.join(name);
            fs::create_dir_all(&path).map_err(|e| io_error(&path, e))?;
        }
        write_whole(&folder.join("intrinsics.txt"), intrinsics(&camera).as_bytes())?;
        Ok(Self {
            rgb: List::create(folder, "rgb.txt", "timestamp filename (8-bit sRGB)")?,
            depth: List::create(folder, "depth.txt", DEPTH_HEADER)?,
            associations: List::create(
                folder,
                "associations.txt",
                "rgb timestamp, file, depth timestamp, file",
            )?,
            poses: None,
            second_depth: None,
            folder: folder.to_owned(),
            camera,
            color_format,
            depth_compression,
            frames: 0,
        })
    }

    /// Adds a second depth picture a frame: folder `name`, list `name.txt`.
    pub fn with_second_depth(mut self, name: &str) -> Result<Self, CaptureError> {
        let path = self.folder.join(name);
        fs::create_dir_all(&path).map_err(|e| io_error(&path, e))?;
        let list = List::create(&self.folder, &format!("{name}.txt"), DEPTH_HEADER)?;
        self.second_depth = Some((name.to_owned(), list));
        Ok(self)
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// A picture does not have the camera's size, or cannot be written; a second depth picture is
    /// missing or unexpected.
    pub fn push(&mut self, frame: &FrameRef) -> Result<(), CaptureError> {
        self.check(frame)?;
        let time = format!("{:.6}", frame.timestamp_s);
        let color = format!("rgb/{time}.{}", self.color_format.extension());
        let path = self.folder.join(&color);
        let bytes = self.color_format.encode(frame.color).map_err(|e| image_error(&path, e))?;
        write_whole(&path, &bytes)?;
        let compression = self.depth_compression;
        let depth = write_depth(&self.folder, "depth", &time, frame.depth_m, compression)?;
        if let (Some((name, list)), Some(second_m)) = (&mut self.second_depth, frame.second_depth_m)
        {
            let second = write_depth(&self.folder, name, &time, second_m, compression)?;
            list.add(&format!("{time} {second}"))?;
        }
        if let Some(pose) = frame.world_from_camera {
            if self.poses.is_none() {
                self.poses = Some(List::create(&self.folder, "groundtruth.txt", POSE_HEADER)?);
            }
            if let Some(list) = &mut self.poses {
                list.add(&pose_line(&time, pose))?;
            }
        }
        self.depth.add(&format!("{time} {depth}"))?;
        self.rgb.add(&format!("{time} {color}"))?;
        self.associations.add(&format!("{time} {color} {time} {depth}"))?;
        self.frames += 1;
        Ok(())
    }

    /// Makes sure that the lists have reached the disk; returns the number of frames.
    pub fn finish(self) -> Result<usize, CaptureError> {
        let second = self.second_depth.as_ref().map(|(_, list)| list);
        let lists = [&self.rgb, &self.depth, &self.associations];
        for list in lists.into_iter().chain(second).chain(self.poses.as_ref()) {
            list.file.sync_all().map_err(|e| io_error(&list.path, e))?;
        }
        Ok(self.frames)
    }

    fn check(&self, frame: &FrameRef) -> Result<(), CaptureError> {
        if frame.second_depth_m.is_some() != self.second_depth.is_some() {
            let problem = "a second depth picture must come with every frame or with none".into();
            return Err(CaptureError::Frame { frame: self.frames, problem });
        }
        let expected = self.camera.size();
        let sizes = [
            ("colour", Some(frame.color.size())),
            ("depth", Some(frame.depth_m.size())),
            ("second depth", frame.second_depth_m.map(Image::size)),
        ];
        for (what, size) in sizes {
            if let Some(size) = size.filter(|&s| s != expected) {
                let problem = format!("{what} picture is {size}, the camera is {expected}");
                return Err(CaptureError::Frame { frame: self.frames, problem });
            }
        }
        Ok(())
    }
}

/// Writes `folder/name/time.png`; returns the name relative to `folder`.
fn write_depth(
    folder: &Path,
    name: &str,
    time: &str,
    depth_m: &Image<f32>,
    compression: DepthCompression,
) -> Result<String, CaptureError> {
    let file = format!("{name}/{time}.png");
    let path = folder.join(&file);
    let bytes = encode_depth(depth_m, compression).map_err(|e| image_error(&path, e))?;
    write_whole(&path, &bytes)?;
    Ok(file)
}

const DEPTH_HEADER: &str = "timestamp filename (16-bit PNG, z-depth, 5000 per metre, 0 = none)";
const POSE_HEADER: &str =
    "timestamp tx ty tz qx qy qz qw (camera-to-world, camera x right, y down, z forward)";

fn intrinsics(c: &Pinhole) -> String {
    format!(
        "# fx fy cx cy width height depth_scale\n{:?} {:?} {:?} {:?} {} {} {DEPTH_SCALE}\n",
        c.fx, c.fy, c.cx, c.cy, c.width, c.height
    )
}

fn pose_line(time: &str, pose: &Pose) -> String {
    let (t, q) = (pose.translation.vector, pose.rotation.coords);
    format!("{time} {:.8} {:.8} {:.8} {:.8} {:.8} {:.8} {:.8}", t.x, t.y, t.z, q.x, q.y, q.z, q.w)
}

/// A text file that grows by whole lines.
#[derive(Debug)]
struct List {
    path: PathBuf,
    file: File,
}

impl List {
    fn create(folder: &Path, name: &str, header: &str) -> Result<Self, CaptureError> {
        let path = folder.join(name);
        let mut file = File::create(&path).map_err(|e| io_error(&path, e))?;
        file.write_all(format!("# {header}\n").as_bytes()).map_err(|e| io_error(&path, e))?;
        Ok(Self { path, file })
    }

    /// One write a line, so that a line is there whole or not at all.
    fn add(&mut self, line: &str) -> Result<(), CaptureError> {
        self.file.write_all(format!("{line}\n").as_bytes()).map_err(|e| io_error(&self.path, e))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Size;

    fn camera() -> Pinhole {
        Pinhole { width: 7, height: 5, fx: 6.5, fy: 6.0, cx: 3.0, cy: 2.0 }
    }

    fn writer(folder: &Path) -> TumWriter {
        TumWriter::create(folder, camera(), ColorFormat::Png, DepthCompression::Small)
            .expect("an empty folder")
    }

    #[test]
    fn pictures_and_lists_come_back() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let size = Size::new(7, 5);
        let color = Image::from_vec(size, (0..35u8).map(|i| [i, 2 * i, 7 * i]).collect());
        let depth_m = Image::from_vec(size, (0..35).map(|i| i as f32 * 0.25).collect());
        let pose = crate::math::pose_from_xyzw([1.0, -2.0, 0.5], [0.5, -0.5, 0.5, 0.5])
            .expect("a unit quaternion");
        let mut out = writer(folder.path());
        for i in 0..3 {
            out.push(&FrameRef {
                timestamp_s: 1000.0 + f64::from(i) / 30.0,
                color: &color,
                depth_m: &depth_m,
                second_depth_m: None,
                world_from_camera: Some(&pose),
            })
            .expect("room on the disk");
        }
        assert_eq!(out.finish().expect("a synced disk"), 3);

        let read = |name: &str| fs::read_to_string(folder.path().join(name)).expect(name);
        assert_eq!(read("rgb.txt").lines().nth(2), Some("1000.033333 rgb/1000.033333.png"));
        assert_eq!(
            read("associations.txt").lines().nth(3),
            Some("1000.066667 rgb/1000.066667.png 1000.066667 depth/1000.066667.png")
        );
        assert_eq!(read("intrinsics.txt").lines().nth(1), Some("6.5 6.0 3.0 2.0 7 5 5000"));
        assert!(read("groundtruth.txt").contains("1000.000000 1.00000000 -2.00000000 0.5"));
        let back = image::open(folder.path().join("rgb/1000.000000.png")).expect("a PNG");
        assert_eq!(back.into_rgb8().into_raw(), color.as_slice().as_flattened());
        let back = image::open(folder.path().join("depth/1000.000000.png")).expect("a PNG");
        let steps: Vec<u16> = depth_m.as_slice().iter().map(|&d| depth_steps(d)).collect();
        assert_eq!(back.into_luma16().into_raw(), steps);
        let left = fs::read_dir(folder.path().join("rgb")).expect("a folder").count();
        assert_eq!(left, 3, "no temporary file stays");
    }

    #[test]
    fn second_depth_has_a_folder_and_list_of_its_own() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut out = writer(folder.path()).with_second_depth("depth_noisy").expect("a folder");
        let size = Size::new(7, 5);
        let (color, depth_m) = (Image::new(size, [9; 3]), Image::new(size, 2.0));
        let second = Image::new(size, 2.1);
        let mut frame = FrameRef {
            timestamp_s: 7.5,
            color: &color,
            depth_m: &depth_m,
            second_depth_m: Some(&second),
            world_from_camera: None,
        };
        out.push(&frame).expect("room on the disk");
        frame.second_depth_m = None;
        assert!(out.push(&frame).is_err(), "a frame without its second depth");
        let list = fs::read_to_string(folder.path().join("depth_noisy.txt")).expect("a list");
        assert_eq!(list.lines().nth(1), Some("7.500000 depth_noisy/7.500000.png"));
        let back = image::open(folder.path().join("depth_noisy/7.500000.png")).expect("a PNG");
        assert!(back.into_luma16().into_raw().iter().all(|&d| d == 10_500));
        assert!(!folder.path().join("groundtruth.txt").exists());
    }

    #[test]
    fn broken_depth_is_missing() {
        assert_eq!(depth_steps(1.0), 5000);
        assert_eq!(depth_steps(13.107), 65535);
        for broken in [-1.0, 13.2, f32::NAN, f32::INFINITY] {
            assert_eq!(depth_steps(broken), 0);
        }
    }

    #[test]
    fn refuses_wrong_sizes_and_used_folders() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut out = writer(folder.path());
        let color = Image::new(Size::new(7, 4), [0; 3]);
        let depth_m = Image::new(Size::new(7, 5), 1.0);
        let error = out
            .push(&FrameRef {
                timestamp_s: 0.0,
                color: &color,
                depth_m: &depth_m,
                second_depth_m: None,
                world_from_camera: None,
            })
            .expect_err("the sizes differ");
        assert!(error.to_string().contains("7x4"), "{error}");
        let second =
            TumWriter::create(folder.path(), camera(), ColorFormat::Png, DepthCompression::Fast);
        assert!(second.is_err());
    }
}
