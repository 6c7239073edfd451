//! Every mode without requests, and what changes it.

#[cfg(feature = "engine")]
use wrapyfi_core::communicator::Configuration;
use wrapyfi_core::communicator::{MethodError, Mode};
use wrapyfi_endpoint::DropReason;

#[cfg(feature = "engine")]
use super::robot::Nobody;
use super::robot::{RobotCommunicator, RobotMethod, context, image, robot};

#[test]
fn without_a_mode_the_method_is_itself() {
    let mut robot = robot(&context());
    assert_eq!(robot.say("nonsense", "hi", true).unwrap().as_deref(), Some("hi 1"));
    assert_eq!(robot.inner().runs(), 1);
    robot.activate(RobotMethod::Say, Mode::Disable).unwrap();
    assert_eq!(robot.say("nonsense", "hi", true).unwrap(), None);
    let (object, (image, sound), other) = {
        robot.activate("sense", "disable").unwrap();
        robot.sense(1).unwrap()
    };
    assert!(object.is_none() && image.is_none() && sound.is_none() && other.is_none());
    assert_eq!(robot.into_inner().runs(), 1);
}

#[test]
fn what_is_published_is_heard_and_the_body_runs_once() {
    let context = context();
    let (mut here, mut there) = (robot(&context), robot(&context));
    here.activate(RobotMethod::Say, Mode::Publish).unwrap();
    there.activate("say", "listen").unwrap();
    assert_eq!(there.say("memory", "", false).unwrap(), None);
    for turn in 1..=3 {
        let said = here.say("memory", "hello", true).unwrap();
        assert_eq!(said, Some(format!("hello {turn}")));
        assert_eq!(there.say("ignored after the first call", "", true).unwrap(), said);
    }
    assert_eq!(there.inner().runs(), 0);
    let status = here.status(RobotMethod::Say);
    assert_eq!(status[0].ends[0].counters.sent, 3);
    assert_eq!(status[0].ends[0].endpoint.to_string(), "memory:/say");
}

#[test]
fn a_listener_waits_and_is_woken_by_the_message() {
    let context = context();
    let mut there = robot(&context);
    there.activate(RobotMethod::Say, Mode::Listen).unwrap();
    let mut here = robot(&context);
    here.activate(RobotMethod::Say, Mode::Publish).unwrap();
    std::thread::scope(|scope| {
        let heard = scope.spawn(|| there.say("memory", "", true).unwrap());
        // Waits for the listener before the body runs, so nothing is said in vain.
        assert_eq!(here.say("memory", "hello", true).unwrap().as_deref(), Some("hello 1"));
        assert_eq!(heard.join().unwrap().as_deref(), Some("hello 1"));
    });
}

#[test]
fn values_travel_each_on_its_own_and_an_absent_middleware_is_none() {
    let context = context();
    let (mut here, mut there) = (robot(&context), robot(&context));
    here.activate(RobotMethod::Sense, Mode::Publish).unwrap();
    there.activate(RobotMethod::Sense, Mode::Listen).unwrap();
    assert_eq!(there.sense(2).unwrap(), (None, (None, None), None));
    let (object, (picture, absent), last) = here.sense(2).unwrap();
    assert!(absent.is_some(), "a publisher returns its own values");
    let heard = there.sense(2).unwrap();
    assert_eq!(heard, (object, (picture, None), last));
    let status = there.status(RobotMethod::Sense);
    assert_eq!(status[2].absent.as_deref(), Some("yarp"));
    assert_eq!(status.len(), 4);
}

#[test]
fn what_is_not_as_the_option_says_is_refused_on_both_sides() {
    let context = context();
    let (mut here, mut there) = (robot(&context), robot(&context));
    here.activate(RobotMethod::Sense, Mode::Publish).unwrap();
    there.activate(RobotMethod::Sense, Mode::Listen).unwrap();
    assert_eq!(there.sense(3).unwrap().0, None);
    here.sense(2).unwrap();
    let error = there.sense(3).unwrap_err();
    assert!(matches!(error, MethodError::WrongType { .. }), "{error}");
    let text = error.to_string();
    assert!(text.contains("Robot::sense") && text.contains("memory:/image"), "{text}");
    assert!(text.contains("the image's width is 2, and the option says width = 3"), "{text}");
    // The option was fixed by the first call.
    let error = here.sense(3).unwrap_err();
    assert!(matches!(error, MethodError::Send { .. }), "{error}");
}

#[test]
fn an_image_that_is_none_is_not_sent() {
    let context = context();
    let (mut here, mut there) = (robot(&context), robot(&context));
    here.activate(RobotMethod::Picture, Mode::Publish).unwrap();
    there.activate(RobotMethod::Picture, Mode::Listen).unwrap();
    assert_eq!(there.picture(true).unwrap(), None);
    assert_eq!(here.picture(false).unwrap(), Some(None));
    assert_eq!(there.picture(true).unwrap(), None);
    assert_eq!(here.picture(true).unwrap(), Some(Some(image(1))));
    assert_eq!(there.picture(true).unwrap(), Some(Some(image(1))));
}

#[test]
fn transceive_and_reemit_meet_on_swapped_topics() {
    let context = context();
    let (mut first, mut second) = (robot(&context), robot(&context));
    first.activate(RobotMethod::Chat, Mode::Transceive).unwrap();
    second.activate(RobotMethod::Chat, Mode::Reemit).unwrap();
    // Opens its ends; nothing is there yet.
    assert_eq!(second.chat("/b", "/a", None, b"second").unwrap(), Some(vec!["second".to_owned()]));
    assert_eq!(first.chat("/a", "/b", None, b"first").unwrap(), None);
    until_heard(&second);
    let own = second.chat("", "", None, b"second").unwrap().unwrap();
    assert_eq!(own, ["first", "second"]);
    let back = first.chat("", "", None, b"again").unwrap().unwrap();
    assert_eq!(back, ["first", "second"]);
    // A receiver gets the same without sending anything on.
    second.activate(RobotMethod::Chat, Mode::Receive).unwrap();
    assert_eq!(second.chat("", "", None, b"x").unwrap().unwrap(), ["x"]);
    // Its listener is another one than before.
    until_heard(&first);
    first.chat("", "", None, b"third").unwrap();
    assert_eq!(second.chat("", "", None, b"x").unwrap().unwrap(), ["third", "x"]);
}

/// Waits until what `robot` says in its chat has a listener.
fn until_heard(robot: &RobotCommunicator) {
    let is_heard = || {
        let status = robot.status(RobotMethod::Chat);
        status[0].ends[0].link.peers == Some(1)
    };
    while !is_heard() {
        std::thread::yield_now();
    }
}

#[test]
fn modes_change_at_run_time_and_end_what_waits() {
    let context = context();
    let mut robot = robot(&context);
    robot.activate(RobotMethod::Say, Mode::Listen).unwrap();
    let control = robot.control();
    std::thread::scope(|scope| {
        let waiting = scope.spawn(|| robot.say("memory", "", true).unwrap_err());
        while control.status(RobotMethod::Say)[0].ends.is_empty() {
            std::thread::yield_now();
        }
        // Repeated, because the call may not wait yet.
        while !waiting.is_finished() {
            control.cancel(RobotMethod::Say);
            std::thread::yield_now();
        }
        let error = waiting.join().unwrap();
        assert!(matches!(error, MethodError::Cancelled { .. }), "{error:?}");
        assert!(error.to_string().contains("a message on memory:/say"), "{error}");
    });
    std::thread::scope(|scope| {
        let waiting = scope.spawn(|| {
            // The last one is called in the new mode.
            std::iter::from_fn(|| robot.say("memory", "x", true).err()).collect::<Vec<_>>()
        });
        control.activate("say", "none").unwrap();
        let errors = waiting.join().unwrap();
        assert!(
            errors.iter().all(|error| matches!(error, MethodError::Ended { .. })),
            "{errors:?}"
        );
    });
    assert_eq!(robot.say("memory", "x", true).unwrap().as_deref(), Some("x 2"));
}

#[test]
fn close_forgets_what_the_first_call_said() {
    let context = context();
    let mut robot = robot(&context);
    robot.activate(RobotMethod::Chat, Mode::Publish).unwrap();
    robot.chat("/a", "/one", None, b"").unwrap();
    let end =
        |robot: &RobotCommunicator| robot.status(RobotMethod::Chat)[0].ends[0].endpoint.to_string();
    assert_eq!(end(&robot), "memory:/one");
    robot.activate(RobotMethod::Chat, Mode::Listen).unwrap();
    robot.activate(RobotMethod::Chat, Mode::Publish).unwrap();
    robot.chat("/a", "/two", None, b"").unwrap();
    assert_eq!(end(&robot), "memory:/one", "kept until close");
    robot.close_method(RobotMethod::Chat);
    assert!(robot.status(RobotMethod::Chat)[0].ends.is_empty());
    robot.chat("/a", "/two", None, b"").unwrap();
    assert_eq!(end(&robot), "memory:/two");
}

#[test]
fn a_list_gives_each_instance_its_mode() {
    let context = context();
    let modes = [Mode::Publish, Mode::Listen];
    let (mut first, mut second, mut third) = (robot(&context), robot(&context), robot(&context));
    first.activate(RobotMethod::Say, modes).unwrap();
    second.activate(RobotMethod::Say, &modes[..]).unwrap();
    assert_eq!((first.mode(RobotMethod::Say), second.mode(RobotMethod::Say)), modes.into());
    let error = third.activate("say", ["publish", "listen"]).unwrap_err().to_string();
    assert!(error.contains("listed for 2 instances, and this is instance 3"), "{error}");
}

#[cfg(feature = "engine")]
#[test]
fn a_configuration_gives_modes_and_its_mistakes_are_told_by_calls() {
    let text = "Robot:\n  say: [publish, listen]\n  add: null\nNobody:\n  nod: publish\n";
    let context = context();
    context.configure(Configuration::from_yaml(text, "modes.yml").unwrap());
    let (first, second, mut third) = (robot(&context), robot(&context), robot(&context));
    assert_eq!(first.mode(RobotMethod::Say), Mode::Publish);
    assert_eq!(second.mode(RobotMethod::Say), Mode::Listen);
    let error = third.say("memory", "", false).unwrap_err().to_string();
    assert!(error.starts_with("modes.yml:2: modes of Robot::say are listed for 2"), "{error}");
    assert!(third.sense(1).is_ok(), "other methods are not concerned");
    third.activate(RobotMethod::Say, Mode::None).unwrap();
    assert!(third.say("memory", "", false).is_ok());
    let nobody = Nobody.communicator_in(&context);
    let error = nobody.poll().unwrap_err().to_string();
    assert!(error.starts_with("modes.yml:5: Nobody has no registered method \"nod\""), "{error}");
}

#[test]
fn nobody_listens_and_nothing_is_made() {
    let mut robot = robot(&context());
    robot.activate(RobotMethod::Sense, Mode::Publish).unwrap();
    for _ in 0..3 {
        robot.sense(1).unwrap();
    }
    let status = robot.status(RobotMethod::Sense);
    assert_eq!(status[0].ends[0].counters.dropped_for(DropReason::NoConsumer), 3);
    assert_eq!(status[0].ends[0].counters.sent, 0);
}
