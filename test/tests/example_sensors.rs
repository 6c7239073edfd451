//! The examples of sensors: pictures and sound from files arrive unchanged on the other side, which
//! displays and plays them.

use wrapyfi_e2e::{Need, Process, Result, run, sha256, texts};

const CAMERA: &[Need] = &[Need::Program, Need::Python, Need::Example("camera")];
const MICROPHONE: &[Need] = &[Need::Program, Need::Python, Need::Example("microphone")];

/// A camera of PNG files, `camera`, and a display, `display`: frames arrive and are saved unchanged.
fn displayed(test: &str, camera: &str, display: &str) -> Result {
    run(test, CAMERA, |env| {
        let _broker = env.broker()?;
        let scenes = env.scenes()?;
        let (frames, saved) = (scenes.folder.join("frames"), env.path("saved"));
        let start = |program: &str, args: &str| match program {
            "python" => env.peer("camera.py", args),
            mware => env.example("camera", &format!("{args} --mware {mware}")),
        };
        let display = start(display, &format!("--mode listen --save {}", saved.display()))?;
        // Once: a queue has room for all of them, however slow the display is.
        let args = format!("--mode publish --once --source {}", frames.display());
        let mut camera = start(camera, &args)?;
        assert_eq!(texts(&display.messages(5)?, "sha256"), scenes.frames);
        camera.exits_with(0)?;
        // A camera takes the saved pictures from there.
        let again = env.peer("camera.py", &format!("--once --source {}", saved.display()))?;
        assert_eq!(texts(&again.messages(5)?, "sha256"), scenes.frames);
        Ok(())
    })
}

#[test]
fn rust_shows_what_python_sees() -> Result {
    displayed("rust_shows_what_python_sees", "python", "zeromq")
}

#[test]
fn python_shows_what_rust_sees() -> Result {
    displayed("python_shows_what_rust_sees", "zeromq", "python")
}

#[test]
fn rust_shows_what_rust_sees_over_ros2() -> Result {
    displayed("rust_shows_what_rust_sees_over_ros2", "ros2", "ros2")
}

#[test]
fn a_display_sketches() -> Result {
    run("a_display_sketches", CAMERA, |env| {
        let frames = env.scenes()?.folder.join("corner");
        let args = format!("--once --sketch 11 --source {}", frames.display());
        let mut camera = env.example("camera", &args)?;
        camera.exits_with(0)?;
        // 200 of 256 is the eighth of ten letters; four lines, because letters are high.
        let sketch = camera.stdout().lines().take(4).map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(sketch, ["#", "", "", ""], "{}", camera.tail());
        assert!(camera.stdout().contains("[9,11,3]"));
        Ok(())
    })
}

/// JPEG files are decoded on the other side.
fn compressed(test: &str, camera: &str, display: &str) -> Result {
    run(test, CAMERA, |env| {
        let _broker = env.broker()?;
        let frames = env.scenes()?.folder.join("sad");
        let saved = env.path("saved");
        let start = |program: &str, args: &str| match program {
            "python" => env.peer("camera.py", &format!("{args} --jpg")),
            mware => env.example("camera", &format!("{args} --mware {mware} --jpg")),
        };
        let display = start(display, &format!("--mode listen --save {}", saved.display()))?;
        let _camera = start(camera, &format!("--mode publish --source {}", frames.display()))?;
        display.messages(2)?;
        // One shade survives JPEG exactly.
        let again = env.peer("camera.py", &format!("--source {}", saved.display()))?;
        let grey = sha256(&[140; 24 * 32 * 3]);
        assert_eq!(texts(&again.messages(2)?, "sha256"), [grey.clone(), grey]);
        Ok(())
    })
}

#[test]
fn rust_decodes_the_jpeg_of_python() -> Result {
    compressed("rust_decodes_the_jpeg_of_python", "python", "zeromq")
}

#[test]
fn python_decodes_the_jpeg_of_rust() -> Result {
    compressed("python_decodes_the_jpeg_of_rust", "zeromq", "python")
}

#[test]
fn jpeg_goes_over_ros2() -> Result {
    compressed("jpeg_goes_over_ros2", "ros2", "ros2")
}

/// A file spoken once is what the other side has played in the end.
fn played(test: &str, microphone: &str, loudspeaker: &str) -> Result {
    run(test, MICROPHONE, |env| {
        let _broker = env.broker()?;
        let scenes = env.scenes()?;
        let (voice, heard) = (scenes.folder.join("voice.wav"), env.path("heard.wav"));
        // 2000 frames are five chunks.
        let start = |program: &str, args: &str| -> Result<Process> {
            match program {
                "python" => env.peer("microphone.py", &format!("{args} --chunk 400 --channels 2")),
                mware => env.example("microphone", &format!("{args} --chunk 400 --mware {mware}")),
            }
        };
        let loudspeaker = start(loudspeaker, &format!("--mode listen --play {}", heard.display()))?;
        let source = format!("--mode publish --once --source {}", voice.display());
        let mut microphone = start(microphone, &source)?;
        let chunks = loudspeaker.messages(5)?;
        assert!(chunks.iter().all(|chunk| chunk["rate"] == 8000), "{chunks:?}");
        microphone.exits_with(0)?;
        let sent = texts(&microphone.messages(5)?, "sha256");
        assert_eq!(texts(&chunks, "sha256"), sent);
        // The whole file as one chunk: the same samples.
        let whole = format!("--once --chunk 2000 --source {}", heard.display());
        let whole = env.example("microphone", &whole)?;
        assert_eq!(texts(&whole.messages(1)?, "sha256"), [scenes.voice]);
        Ok(())
    })
}

#[test]
fn rust_plays_what_python_hears() -> Result {
    played("rust_plays_what_python_hears", "python", "zeromq")
}

#[test]
fn python_plays_what_rust_hears() -> Result {
    played("python_plays_what_rust_hears", "zeromq", "python")
}

#[test]
fn rust_plays_what_rust_hears() -> Result {
    played("rust_plays_what_rust_hears", "zeromq", "zeromq")
}

#[test]
fn rust_plays_what_rust_hears_over_ros2() -> Result {
    played("rust_plays_what_rust_hears_over_ros2", "ros2", "ros2")
}
