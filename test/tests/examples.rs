//! The examples do what their texts say, with real Python Wrapyfi on the other side.

use wrapyfi_e2e::{Need, Result, run};

/// A plug-in of a crate outside the core, and its Python twin: poses there and mirrored poses back.
#[test]
fn poses_go_through_a_plugin_of_the_users_own() -> Result {
    run("poses", &[Need::Program, Need::PoseMirror, Need::Python], |world| {
        let (there, back) = (world.topic("poses"), world.topic("mirrored"));
        let _broker = world.broker()?;
        let mirror = world.pose_mirror(&there, &back)?;
        let script = world.poses(&there, &back)?;
        let heard = script.wait_until("three mirrored poses", |output| {
            let poses = output.out.iter().filter(|line| line.starts_with("Pose Pose("));
            let poses: Vec<_> = poses.cloned().collect();
            (poses.len() >= 3).then_some(poses)
        })?;
        for line in &heard {
            let step = line.split(['=', '.']).nth(1).unwrap_or_default();
            let double = step.parse::<u32>()? * 2;
            let y = if double == 0 { "-0.0".to_owned() } else { format!("-{double}.0") };
            let expected = format!("Pose Pose(x_m={step}.0, y_m={y}, heading_rad=-0.1)");
            assert_eq!(*line, expected);
        }
        mirror.wait_until("the pose in Rust", |output| {
            output.out.iter().any(|line| line.starts_with("Pose2D { x_m: ")).then_some(())
        })
    })
}
