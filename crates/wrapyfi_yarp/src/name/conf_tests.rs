//! Configuration files as users have them, and as they should not have them.

use super::*;

fn conf(host: &str, port: u16) -> NameServerConf {
    NameServerConf { host: host.to_owned(), port }
}

#[test]
fn both_forms_are_read() {
    assert_eq!(NameServerConf::parse("127.0.0.1 10000 yarp\n"), Ok(conf("127.0.0.1", 10_000)));
    assert_eq!(NameServerConf::parse("icub\t10010\n"), Ok(conf("icub", 10_010)));
    assert_eq!(NameServerConf::parse("10.0.0.1\r\n10000\r\n"), Ok(conf("10.0.0.1", 10_000)));
    let ini = "[other]\nhost wrong\n[name]\n// where it is\nhost 10.0.0.2\nport 10020\nmode yarp\n";
    assert_eq!(NameServerConf::parse(ini), Ok(conf("10.0.0.2", 10_020)));
}

#[test]
fn what_is_no_configuration_is_explained() {
    for (text, says) in [
        ("", "names no host"),
        ("onlyhost", "names no host"),
        ("host 70000", "\"70000\" is not a port"),
        ("host 0", "\"0\" is not a port"),
        ("host 11311 ros", "mode \"ros\""),
        ("[group]\nhost a\nport 1\n", "no group [name]"),
        ("[name]\nhost a\nport x\n", "\"x\" is not a port"),
    ] {
        let error = NameServerConf::parse(text).unwrap_err();
        assert!(error.contains(says), "{text:?}: {error}");
    }
}

#[test]
fn files_are_found_by_namespace_and_errors_name_them() {
    let folder = tempfile::tempdir().unwrap();
    let environment = Environment::default().with("YARP_CONFIG_HOME", folder.path());
    let missing = locate(&environment).unwrap_err().to_string();
    assert!(missing.contains("yarp.conf does not exist"), "{missing}");

    let file = file_of(&environment, "/root").unwrap();
    conf("127.0.0.1", 10_000).write(&file).unwrap();
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "127.0.0.1 10000 yarp\n");
    let located = locate(&environment).unwrap();
    assert_eq!((located.namespace.as_str(), located.server.port), ("/root", 10_000));

    std::fs::write(folder.path().join("yarp_namespace.conf"), "/icub01 /other\n").unwrap();
    let missing = locate(&environment).unwrap_err().to_string();
    assert!(missing.contains("_icub01.conf does not exist"), "{missing}");
    let renamed = environment.clone().with("YARP_NAMESPACE", "/root");
    assert_eq!(locate(&renamed).unwrap().namespace, "/root");

    std::fs::write(folder.path().join("_icub01.conf"), b"\xff\xfe").unwrap();
    let text = locate(&environment).unwrap_err().to_string();
    assert!(text.contains("_icub01.conf: is not UTF-8"), "{text}");
    std::fs::remove_file(folder.path().join("_icub01.conf")).unwrap();
    std::fs::create_dir(folder.path().join("_icub01.conf")).unwrap();
    let unreadable = locate(&environment).unwrap_err();
    assert!(unreadable.to_string().contains("_icub01.conf: cannot be read: "), "{unreadable}");
}

#[test]
fn without_a_home_there_is_no_folder() {
    assert!(matches!(locate(&Environment::default()), Err(ConfError::NoFolder)));
}
