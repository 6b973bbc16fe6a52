//! `augmented.mp4`, by way of an installed ffmpeg.

use super::{OutputError, atomic};
use crate::image::{Image, Size};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;

/// A video that is being written. Dropping it without [`Video::finish`] leaves no file.
#[derive(Debug)]
pub struct Video {
    path: PathBuf,
    temporary: PathBuf,
    size: Size,
    process: Child,
    /// What ffmpeg says, read while it runs: a full pipe would stop it.
    messages: Option<JoinHandle<String>>,
}

#[derive(Debug)]
pub enum VideoStart {
    Started(Video),
    /// No ffmpeg to be had; the reason is for the user. A run goes on without a video.
    Unavailable(String),
}

impl Video {
    /// Starts a video of frames of this size.
    pub fn start(path: &Path, size: Size, frames_per_s: f64) -> Result<VideoStart, OutputError> {
        Self::start_with(|| Command::new("ffmpeg"), path, size, frames_per_s)
    }

    fn start_with(
        ffmpeg: impl Fn() -> Command,
        path: &Path,
        size: Size,
        frames_per_s: f64,
    ) -> Result<VideoStart, OutputError> {
        if size.pixels() == 0 || !(frames_per_s > 0.0 && frames_per_s.is_finite()) {
            let problem = format!("no video of {size} with {frames_per_s} frames a second");
            return Err(OutputError::content(path, problem));
        }
        let unavailable = |why| Ok(VideoStart::Unavailable(format!("no video: ffmpeg {why}")));
        let encoders = match ffmpeg().args(["-hide_banner", "-encoders"]).output() {
            Ok(output) if output.status.success() => output.stdout,
            Ok(output) => return unavailable(format!("does not run ({})", output.status)),
            Err(error) => return unavailable(format!("cannot be started: {error}")),
        };
        let encoders = String::from_utf8_lossy(&encoders).into_owned();
        let codec = codec_arguments(&encoders);

        let temporary = atomic::temporary_beside(path)?;
        // Makes the folder, and finds out early where nothing can be written.
        atomic::create(&temporary).map_err(|error| OutputError::io(path, error))?;
        let mut encoder = ffmpeg();
        // Ctrl-C goes to all that runs in a terminal's foreground: ffmpeg is to end with its input, not before.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut encoder, 0);
        let mut process = encoder
            .args(["-hide_banner", "-loglevel", "error", "-nostdin", "-y"])
            .args(["-f", "rawvideo", "-pixel_format", "rgb24"])
            .args(["-video_size", &size.to_string(), "-framerate", &frames_per_s.to_string()])
            .args(["-i", "pipe:0"])
            .args(codec)
            // players want 4:2:0, and that wants even sizes
            .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p"])
            .args(["-movflags", "+faststart", "-f", "mp4"])
            .arg(&temporary)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| {
                let _ = std::fs::remove_file(&temporary); // the first error counts
                OutputError::io(path, error)
            })?;
        let messages = process.stderr.take().map(|mut stderr| {
            std::thread::spawn(move || {
                let mut text = Vec::new();
                let _ = stderr.read_to_end(&mut text); // what came before an error is all there is
                String::from_utf8_lossy(&text).trim().to_owned()
            })
        });
        let path = path.to_owned();
        Ok(VideoStart::Started(Video { path, temporary, size, process, messages }))
    }

    /// Appends a frame.
    pub fn push(&mut self, frame: &Image<[u8; 3]>) -> Result<(), OutputError> {
        if frame.size() != self.size {
            let problem = format!("a frame of {} in a video of {}", frame.size(), self.size);
            return Err(OutputError::content(&self.path, problem));
        }
        let Some(pipe) = self.process.stdin.as_mut() else { return Err(self.failure()) };
        match pipe.write_all(frame.as_slice().as_flattened()) {
            Ok(()) => Ok(()),
            Err(_) => Err(self.failure()), // ffmpeg's own words say more than "broken pipe"
        }
    }

    /// Waits for ffmpeg and gives the file its name.
    pub fn finish(mut self) -> Result<(), OutputError> {
        drop(self.process.stdin.take());
        let status = self.process.wait().map_err(|error| OutputError::io(&self.path, error))?;
        if !status.success() {
            return Err(self.failure());
        }
        std::fs::rename(&self.temporary, &self.path)
            .map_err(|error| OutputError::io(&self.path, error))
    }

    /// Waits for the process, which ends where its input does, and tells what it said.
    fn failure(&mut self) -> OutputError {
        drop(self.process.stdin.take());
        let _ = self.process.wait(); // its words are what counts
        let said = self.messages.take().and_then(|thread| thread.join().ok());
        let said = said.filter(|text| !text.is_empty());
        let said = said.unwrap_or_else(|| "it ended without a word".to_owned());
        OutputError::content(&self.path, format!("ffmpeg failed: {said}"))
    }
}

impl Drop for Video {
    fn drop(&mut self) {
        drop(self.process.stdin.take());
        // Both fail only for a process that has ended already.
        let _ = self.process.kill();
        let _ = self.process.wait();
        let _ = std::fs::remove_file(&self.temporary); // renamed already where the video is whole
    }
}

/// H.264 where this ffmpeg has it, else MPEG-4, which every ffmpeg has.
fn codec_arguments(encoders: &str) -> &'static [&'static str] {
    if encoders.split_whitespace().any(|word| word == "libx264") {
        &["-c:v", "libx264", "-preset", "veryfast", "-crf", "18"]
    } else {
        &["-c:v", "mpeg4", "-q:v", "3"]
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// A shell script in place of ffmpeg; its last argument is the file to write.
    fn started(encode: &str, path: &Path) -> Video {
        let script = format!(
            "case \"$*\" in *-encoders*) echo ' V libx264 x'; exit 0;; esac\n\
             for last; do :; done\n{encode}\n"
        );
        let ffmpeg = || {
            let mut command = Command::new("sh");
            command.args(["-c", &script, "ffmpeg"]);
            command
        };
        match Video::start_with(ffmpeg, path, Size::new(3, 2), 30.0).unwrap() {
            VideoStart::Started(video) => video,
            VideoStart::Unavailable(why) => panic!("{why}"),
        }
    }

    fn frame(value: u8) -> Image<[u8; 3]> {
        Image::new(Size::new(3, 2), [value, 0, 255])
    }

    fn left_in(folder: &Path) -> usize {
        std::fs::read_dir(folder).unwrap().count()
    }

    #[test]
    fn frames_arrive_in_order_and_the_file_gets_its_name_at_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let path = out.join("augmented.mp4");
        let mut video = started("cat > \"$last\"", &path);
        video.push(&frame(1)).unwrap();
        video.push(&frame(2)).unwrap();
        assert!(!path.exists());
        let wrong = Image::new(Size::new(2, 2), [0; 3]);
        let message = video.push(&wrong).unwrap_err().to_string();
        assert!(message.ends_with("a frame of 2x2 in a video of 3x2"), "{message}");
        video.finish().unwrap();
        let expected = [[1, 0, 255].repeat(6), [2, 0, 255].repeat(6)].concat();
        assert_eq!(std::fs::read(&path).unwrap(), expected);
        assert_eq!(left_in(&out), 1);
    }

    #[test]
    fn a_failing_encoder_is_quoted_and_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let failing = "cat > /dev/null; echo 'no such codec' >&2; exit 1";
        let mut video = started(failing, &out.join("augmented.mp4"));
        video.push(&frame(1)).unwrap();
        let message = video.finish().unwrap_err().to_string();
        assert!(message.ends_with("augmented.mp4: ffmpeg failed: no such codec"), "{message}");
        assert_eq!(left_in(&out), 0);

        let mut video = started("echo 'disk full' >&2; exit 1", &out.join("augmented.mp4"));
        let error = (0..100_000).find_map(|_| video.push(&frame(1)).err()).unwrap();
        assert!(error.to_string().ends_with("ffmpeg failed: disk full"), "{error}");
        drop(video);

        drop(started("cat > \"$last\"", &out.join("augmented.mp4")));
        assert_eq!(left_in(&out), 0);
    }

    #[test]
    fn without_ffmpeg_there_is_a_reason_and_no_error() {
        for (program, reason) in [("./not-there", "cannot be started"), ("false", "does not run")] {
            let ffmpeg = || Command::new(program);
            let start = Video::start_with(ffmpeg, Path::new("a.mp4"), Size::new(3, 2), 30.0);
            let VideoStart::Unavailable(why) = start.unwrap() else { panic!() };
            assert!(why.starts_with(&format!("no video: ffmpeg {reason}")), "{why}");
        }
        let empty = Video::start(Path::new("a.mp4"), Size::new(0, 2), 30.0).unwrap_err();
        assert_eq!(empty.to_string(), "a.mp4: no video of 0x2 with 30 frames a second");
    }

    #[test]
    fn a_real_ffmpeg_makes_a_video() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("augmented.mp4");
        let size = Size::new(67, 43);
        match Video::start(&path, size, 29.97).unwrap() {
            VideoStart::Unavailable(why) => println!("SKIPPED: {why}"),
            VideoStart::Started(mut video) => {
                for i in 0..5 {
                    video.push(&Image::new(size, [40 * i, 100, 200])).unwrap();
                }
                video.finish().unwrap();
                let bytes = std::fs::read(&path).unwrap();
                assert_eq!(&bytes[4..8], b"ftyp");
            }
        }
    }
}
