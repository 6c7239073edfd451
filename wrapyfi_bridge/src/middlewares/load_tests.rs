use wrapyfi_engine::Route;
use wrapyfi_interfaces::ros1::Rules;

use super::*;
use crate::edits::Edits;
use crate::own_address::OwnAddress;

fn written(folder: &Path, name: &str, text: &str) -> std::path::PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn a_setting_of_another_kind_is_told_what_to_write() {
    for (text, words) in [
        ("endpoints: 5\n", "`endpoints: { zeromq: { broker: foreign } }`"),
        ("endpoints: { zeromq: { pub_port: many } }\n", "`pub_port: 5555`"),
        ("endpoints: { ros2: { domain_id: seven } }\n", "`domain_id: 0`"),
        ("routes: 5\n", "`routes: [{ from: \"zeromq:/a\", to: \"ros2:/a\", type: Text }]`"),
        ("page: 8642\n", "`page: { port: 8642 }`"),
    ] {
        let told = load_text(text, "file").unwrap_err().to_string();
        assert!(told.contains("write for example") && told.contains(words), "{told}");
    }
}

#[test]
fn all_faults_of_a_file_are_told_at_once() {
    let text = "endpoints:\n  ros2: { domain_id: 500 }\n  zeromq: { pub_port: x, rep_port: 5, req_port: 5 }\ndefaults: { devices: 5 }\nroutes:\n- { from: 'zeromq:/a', to: 'ros2:/a', type: Text, overflow: { block_ms: 5s } }\n- { from: 'zeromq:/b', to: 'ros2:/b', type: Imag }\n- { form: 'zeromq:/c', to: 'ros2:/c', type: Image }\n- { from: 'zermoq:/d', to: 'ros2:/d', type: Image }\n- { service: 'ros:/e', as: 'zeromq:/e', type: std_srvs/srv/SetBol, timeout_ms: -1 }\n- { from: 'ros2:/f', to: 'ros:/f', type: Tex, qos: relable }\n- { from: 'yarp:/g', to: 'ros:/f', type: std_srvs/srv/SetBool, options: { carrier: tpc } }\n- { service: 'ros:/h', as: 'zeromq:/h', encoding: bgr8 }\n- { from: 'yarp:/i', to: 'yarp:/i', type: Text, encoding: rgb8, options: { carier: tcp } }\nlimits: { waiting_mib: lots }\n";
    let told = load_text(text, "file").unwrap_err().to_string();
    let lines: Vec<_> = told.lines().filter_map(|line| line.split(':').nth(1)).collect();
    let services = " zeromq";
    let expected = [
        services, "2", "3", "3", "4", "6", "7", "8", "9", "10", "10", "11", "11", "12", "12", "12",
        "13", "14", "14", "14", "15",
    ];
    assert_eq!(lines, expected, "{told}");
    for words in [
        "write for example `devices: { load_torch_device",
        "write for example `waiting_mib: 1024`",
        "did you mean `SetBool`?",
        "option carrier is \"tpc\", it must be tcp, fast_tcp",
        "std_srvs/srv/SetBool is no message",
        "line 11 already routes to ros:/f",
        "encoding has no effect on Text",
        "did you mean `carrier`?",
    ] {
        assert!(told.contains(words), "{words}: {told}");
    }
}

#[test]
fn what_is_no_text_and_a_second_document_are_told_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let routes = "routes: [{ from: 'zeromq:/a', to: 'ros2:/a', type: Text }]\n";
    let file = folder.path().join("file.yaml");
    std::fs::write(&file, b"# a camera\n# caf\xe9\nroutes: []\n").unwrap();
    let told = load(&file).unwrap_err().to_string();
    assert!(told.contains("line 2: byte 0xe9 is no UTF-8; save the file as UTF-8"), "{told}");
    for mark in ["---", "..."] {
        let told = load_text(&format!("---\n{routes}{mark}\n{routes}"), "file");
        let told = told.unwrap_err().to_string();
        assert!(told.contains("a second document begins here"), "{told}");
    }
}

#[test]
fn faults_of_values_stand_beside_those_of_keys() {
    let text = "definitions: [nowhere]\nendpoints:\n  zeromq:\n    curve: { secret_key_file: nowhere.key_secret }\n    pub_port: x\nhosts: { a: 1.2.3, b: 192.168.1.300 }\nroutes: [{ from: 'zeromq:/a', to: 'ros2:/a', type: Text }]\n";
    let told = load_text(text, "file").unwrap_err().to_string();
    for place in ["file:1:", "file:4:", "file:5:", "file:6:13:", "file:6:23:"] {
        assert!(told.contains(place), "{place}: {told}");
    }
    // Without keys nothing would be encrypted.
    for curve in ["", "{}"] {
        let text = text.replace("{ secret_key_file: nowhere.key_secret }", curve);
        let told = load_text(&text, "file").unwrap_err().to_string();
        assert!(told.contains("file:4:") && told.contains("secret_key_file"), "{told}");
    }
}

#[test]
fn a_setting_may_be_left_empty() {
    let routes = "routes: [{ from: 'zeromq:/a', to: 'ros2:/a', type: Text }]\n";
    let load = |dialect: &str| {
        load_text(&format!("endpoints: {{ yarp: {{ dialect: {dialect} }} }}\n{routes}"), "file")
    };
    for dialect in ["null", "v3", "v4"] {
        load(dialect).unwrap();
    }
    let told = load("v5").unwrap_err().to_string();
    assert!(told.contains("file:1:") && told.contains("write v3 (YARP 3) or v4"), "{told}");
}

#[test]
fn routes_share_a_server_of_zeromq_and_nothing_else() {
    let route = |service: &str, other: &str| {
        format!("- {{ service: '{service}', as: '{other}', type: std_srvs/srv/SetBool }}\n")
    };
    let load = |routes: [&str; 2]| load_text(&format!("routes:\n{}", routes.concat()), "file");
    let call = route("zeromq:/light", "ros2:/light");
    load([&call, &route("zeromq:/light", "yarp:/light")]).unwrap();
    for other in [
        route("zeromq:/lamp", "ros2:/lamp"),
        route("ros:/lamp", "zeromq:/lamp"),
        route("ros:/light", "zeromq:/light"),
    ] {
        let told = load([&call, &other]).unwrap_err().to_string();
        assert!(told.contains("file:3:") && told.contains("requests of the other"), "{told}");
    }
    let told = load([&call, &route("zeromq:/(.*)", "ros2:/$1")]).unwrap_err().to_string();
    assert!(told.contains("file:3:") && told.contains("have no names"), "{told}");
}

#[test]
fn a_fault_of_an_added_route_is_told_without_a_line_of_the_file() {
    let text = "routes:\n  - {name: a, from: 'zeromq:/a', to: 'ros2:/a', type: Text}\n";
    for (entry, wanted) in [
        ("{from: 'zeromq:/b', to: 'ros2:/b', type: Txt}", "\"Txt\" is no message type"),
        (
            "{from: 'zeromq:/a', to: 'ros2:/a', type: Text}",
            "route zeromq:/a -> ros2:/a stands already in line 2",
        ),
    ] {
        let mut edits = Edits::default();
        edits.add(entry).unwrap();
        let read = read(text.to_owned(), "p.yaml", Path::new(""), edits.added(), |_, _, _| Ok(()));
        let told = read.unwrap_err().to_string();
        assert!(told.starts_with(&format!("p.yaml: the added route: {wanted}")), "{told}");
    }
}

#[test]
fn an_argument_goes_before_the_file_and_needs_its_own_word() {
    let mut endpoints = Endpoints::of("{ yarp: { insecure: true } }");
    let own = OwnAddress { ip: Some([192, 0, 2, 7].into()), insecure: false };
    endpoints.reached_at(own);
    assert_eq!(endpoints.said("yarp.ip").as_deref(), Some("192.0.2.7"));
    assert_eq!(endpoints.said("ros.hostname").as_deref(), Some("192.0.2.7"));
    let refused = endpoints.check_permitted(None).unwrap_err().to_string();
    assert!(refused.contains("192.0.2.7") && refused.contains("give --insecure"), "{refused}");
    endpoints.reached_at(OwnAddress { insecure: true, ..own });
    endpoints.check_permitted(None).unwrap();
}

#[test]
fn the_word_of_a_later_place_counts_for_an_address_of_the_file() {
    let yaml = |section: &str| {
        let route = "{ from: 'zeromq:/a', to: 'ros2:/a', type: Text }";
        load_text(&format!("endpoints: {{ {section} }}\nroutes: [{route}]\n"), "file").unwrap()
    };
    for (section, middleware) in [
        ("zeromq: { ip: 0.0.0.0 }", "zeromq"),
        ("zeromq: { ip: '*' }", "zeromq"),
        ("yarp: { ip: 0.0.0.0 }", "yarp"),
        ("ros: { hostname: 0.0.0.0 }", "ros"),
    ] {
        let Loaded { mut endpoints, .. } = yaml(section);
        let refused = endpoints.check_permitted(Some(Path::new("file"))).unwrap_err();
        let expected = format!("write insecure: true under endpoints.{middleware}");
        assert!(matches!(refused, Failure::Usage(_)), "{refused}");
        let told = refused.to_string();
        assert!(told.contains(&expected) && told.contains("0.0.0.0"), "{told}");
        assert!(middleware == "ros" || told.starts_with("file:1:"), "{told}");
        endpoints.reached_at(OwnAddress { insecure: true, ..OwnAddress::default() });
        endpoints.check_permitted(None).unwrap();
        yaml(&section.replace(" }", ", insecure: true }")).endpoints.check_permitted(None).unwrap();
    }
}

#[test]
fn settings_that_no_middleware_starts_with_are_refused_with_their_line() {
    for (section, why) in [
        ("ros: { master_uri: 'localhost:11311' }", "master_uri"),
        ("ros: { master_uri: 'https://localhost:11311' }", "http://host:11311"),
        ("ros2: { domain_id: 300 }", "domains are 0 to 232"),
        ("zeromq: { rep_port: 5558, req_port: 5558 }", "rep_port and req_port are both 5558"),
        ("ros: { node: 1x }", "node: wrapyfi_bridge"),
        ("ros: { namespace: 'a b' }", "namespace: /robot"),
        ("zeromq: { pub_port: 5555, sub_port: 5555 }", "both 5555"),
        (
            "zeromq: { rep_port: 5555 }",
            "pub_port and rep_port are both 5555: give each a port of its own, such as rep_port: 5557",
        ),
        ("zeromq: { ip: '10.0.0.5:5555' }", "write ports as pub_port"),
        (
            "zeromq: { pub_port: 0 }",
            "pub_port is 0, it must be a port from 1 to 65535: write for example pub_port: 5555",
        ),
        ("zeromq: { rep_port: 0, req_port: 0 }", "write for example rep_port: 5558"),
    ] {
        let route = "routes:\n- {from: 'zeromq:/a', to: 'ros2:/a', type: Text}\n";
        let text = format!("{route}endpoints:\n  {section}\n");
        let refused = load_text(&text, "file").unwrap_err();
        let told = refused.to_string();
        assert!(told.starts_with("file:4:") && told.contains(why), "{section}: {told}");
        assert!(!told.contains("ROS_MASTER_URI"), "{told}");
    }
}

#[test]
fn a_page_has_a_port_of_its_own() {
    let load = |text: &str| load_text(text, "file").map(|loaded| loaded.page_port);
    let with = |section: &str, port: u16, route: &str| {
        load(&format!(
            "endpoints: {{ {section} }}\npage: {{ port: {port} }}\nroutes:\n- {{ {route} }}\n"
        ))
    };
    let topic = "from: 'zeromq:/a', to: 'ros2:/a', type: Text";
    let service = "service: 'ros2:/a', as: 'zeromq:/a', type: NativeObject";
    for (section, port, route, server) in [
        ("", 5555, topic, "ZeroMQ broker at 127.0.0.1"),
        ("zeromq: { sub_port: 7000 }", 7000, topic, "ZeroMQ broker at 127.0.0.1"),
        ("", 5558, service, "ZeroMQ broker of services at 127.0.0.1"),
        ("", 11311, "from: 'ros:/a', to: 'ros2:/a', type: Text", "ROS 1 master at localhost"),
    ] {
        let told = with(section, port, route).unwrap_err().to_string();
        let words = format!(
            "page: port is {port}, which the {server} has: give the page a port of its own"
        );
        assert!(told.starts_with("file:2:15: ") && told.contains(&words), "{told}");
        assert!(told.ends_with("such as page: { port: 8642 }"), "{told}");
    }
    let own = "zeromq: { ip: 127.0.0.1, pub_port: 8642 }";
    let told = with(own, 8642, topic).unwrap_err().to_string();
    assert!(told.ends_with("such as page: { port: 8643 }"), "{told}");
    for (section, port, route) in [
        ("", 0, topic),
        ("", 8642, topic),
        ("", 5558, topic),
        ("zeromq: { ip: 10.0.0.5, broker: foreign }", 5555, topic),
        ("", 5555, "from: 'yarp:/a', to: 'ros2:/a', type: Text"),
    ] {
        assert_eq!(with(section, port, route).unwrap(), Some(port), "{section} {port}");
    }
}

#[test]
fn a_second_service_on_the_same_ports_of_zeromq_is_refused() {
    let one = "routes:\n- {service: 'ros2:/a', as: 'zeromq:/a', type: NativeObject}\n";
    load_text(one, "file").unwrap();
    let other = format!("{one}- {{service: 'zeromq:/b', as: 'ros2:/b', type: NativeObject}}\n");
    let error = load_text(&other, "file").unwrap_err().to_string();
    assert!(error.contains("zeromq:/a") && error.contains("zeromq:/b"), "{error}");
}

#[test]
fn what_may_wait_is_bounded_by_the_file() {
    let text = |mib| {
        let route = "{ from: 'zeromq:/a', to: 'ros2:/a', type: Text }";
        format!("limits: {{ waiting_mib: {mib} }}\nroutes: [{route}]\n")
    };
    let loaded = load_text(&text(1), "bridge.yaml").unwrap();
    assert_eq!(loaded.waiting_bytes, Limits::MIB);
    let largest = |loaded: &Loaded| loaded.plan.routes[0].policy.limits.message_bytes;
    assert_eq!(largest(&loaded), Limits::MIB / 4, "what one message may take of it");
    let with = |mib, most| {
        let text = text(mib);
        load_text(&format!("{text}defaults: {{ max_message_mib: {most} }}\n"), "bridge.yaml")
    };
    assert_eq!(largest(&with(64, 16).unwrap()), 16 * Limits::MIB);
    let error = with(64, 20).unwrap_err().to_string();
    assert!(
        error.contains("bridge.yaml:3:") && error.contains("`limits: { waiting_mib: 80 }`"),
        "{error}"
    );
    assert!(error.contains("max_message_mib: 16 at most"), "{error}");
    let error = load_text(&text(0), "bridge.yaml").unwrap_err().to_string();
    assert!(error.contains("waiting_mib is 0, it must be at least 1"), "{error}");
}

#[test]
fn the_example_of_a_robot_with_a_base_on_ros_1_is_valid_without_any_ros() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/from_ros1.yaml");
    let loaded = load(&file).unwrap();
    assert!(loaded.plan.routes.len() > 10, "{loaded:?}");
    let map = loaded.plan.routes.iter().find(|route| route.name == "map").unwrap();
    assert_eq!(map.message_types().to.ros_type(), "nav_msgs/msg/OccupancyGrid");
}

/// Checks every example as `wrapyfi check` does, with nothing of ROS or YARP installed.
#[test]
fn every_example_is_valid() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config");
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let file = entry.unwrap().path();
        let loaded = load(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        let plan = loaded.plan;
        assert!(!plan.routes.is_empty(), "{}", file.display());
        found.push(file.file_name().unwrap().to_str().unwrap().to_owned());
        if file.ends_with("icub.yaml") || file.ends_with("base_on_yarp.yaml") {
            let of_robot = |route: &&Route| route.from.middleware == "yarp";
            let eager = plan.routes.iter().filter(of_robot).find(|route| {
                route.interaction() == Interaction::Topic && route.is_whole() && !route.policy.lazy
            });
            assert_eq!(eager.map(|route| &route.name), None, "it streams at rest");
        }
    }
    for robot in ["icub.yaml", "base_on_yarp.yaml", "pepper_on_ros1.yaml"] {
        assert!(found.iter().any(|file| file == robot), "{robot} is missing in {found:?}");
    }
}

#[test]
fn mapping_rules_are_read_from_beside_the_file_and_faults_have_their_line() {
    let folder = tempfile::tempdir().unwrap();
    let config = |rules: &str| {
        format!(
            "endpoints:\n  ros: {{ mapping_rules: [{rules}] }}\nroutes:\n  - {{ from: \"ros:/a\", \
             to: \"ros2:/a\", type: Text }}\n"
        )
    };
    let rules = "[{ros1_package_name: base_msgs, ros2_package_name: base_interfaces}]";
    written(folder.path(), "rules.yaml", rules);
    let file = written(folder.path(), "bridge.yaml", &config("rules.yaml"));
    let loaded = load(&file).unwrap();
    let rules = format!("{:?}", serde_saphyr::from_str::<Rules>(rules).unwrap());
    assert!(format!("{:?}", loaded.endpoints).contains(&rules), "{loaded:?}");

    written(folder.path(), "bad.yaml", "[{ros1_package_name: base_msgs, ros2: x}]");
    for name in ["bad.yaml", "none.yaml"] {
        let file = written(folder.path(), "bridge.yaml", &config(name));
        let told = load(&file).unwrap_err().to_string();
        assert!(told.contains("bridge.yaml:2:") && told.contains(name), "{told}");
    }
}

#[test]
fn sections_are_known_by_the_list_of_the_program() {
    let routes = "routes: [{ from: 'zeromq:/a', to: 'ros2:/a', type: Text }]\n";
    let load = |endpoints: &str| load_text(&format!("{routes}endpoints:{endpoints}\n"), "file");
    for empty in ["", " {}", " { zeromq: {} }"] {
        load(empty).unwrap();
    }
    let told = load("\n  zermoq: { pub_port: 5 }\n  yarp: { ip: 5 5 }").unwrap_err().to_string();
    for words in [
        "file:3:3: unknown key `zermoq`; did you mean `zeromq`? keys here: zeromq, ros2, ros, yarp",
        "file:4:15: ip \"5 5\" is no address",
    ] {
        assert!(told.contains(words), "{words}: {told}");
    }
    let told = load(" { zeromq: {}, zeromq: {} }").unwrap_err().to_string();
    assert!(told.contains("key `zeromq` is given twice") && told.lines().count() == 1, "{told}");
}

#[test]
fn services_that_nodes_and_bridges_have_about_themselves_are_left_out() {
    let pattern = |from: &str, to: &str| {
        let text = format!("routes: [{{ service: '{from}:/(.*)', as: '{to}:/$1' }}]");
        load_text(&text, "file").unwrap().plan.routes.remove(0)
    };
    for from in ["ros2", "yarp"] {
        let pattern = pattern(from, "ros");
        for name in ["get_parameters", "set_logger_level", "change_state", "add_route", "reload"] {
            assert_eq!(pattern.target(&format!("/a/{name}")), None, "{from}: {name}");
        }
        assert!(pattern.target("/a/light").is_some(), "{from}");
    }
    let from_ros1 = pattern("ros", "ros2");
    assert_eq!(from_ros1.target("/talker/set_logger_level"), None);
    // dynamic_reconfigure's.
    assert!(from_ros1.target("/camera/set_parameters").is_some());
}
