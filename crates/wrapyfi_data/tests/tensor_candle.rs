//! Tensors on the device that a device map names, with candle.
//! `cargo nextest run -p wrapyfi_data --features candle tensor_candle::`

use half::{bf16, f16};
use wrapyfi_data::Limits;
use wrapyfi_data::codec::json;
use wrapyfi_data::plugin::{DeviceMap, DeviceMaps, Framework, Plugins};
use wrapyfi_data::types::{CandleError, Dtype, Element, Origin, Tensor, Value};

fn there_and_back<T: Element>(shape: &[usize], elements: Vec<T>) {
    let tensor = Tensor::from_elements(shape, elements).unwrap();
    let candle = tensor.to_candle().unwrap();
    assert_eq!(candle.dims(), shape);
    assert!(candle.device().is_cpu());
    assert_eq!(Tensor::from_candle(&candle).unwrap(), tensor.with_device("cpu"));
}

#[test]
fn every_type_that_both_have_goes_there_and_back() {
    there_and_back(&[2, 2], vec![1_u8, 2, 3, 255]);
    there_and_back(&[3], vec![1_u32, 2, u32::MAX]);
    there_and_back(&[3], vec![-1_i16, 2, i16::MIN]);
    there_and_back(&[3], vec![-1_i32, 2, i32::MIN]);
    there_and_back(&[1, 3, 1], vec![-1_i64, 2, i64::MIN]);
    there_and_back(&[2], vec![f16::from_f32(1.5), f16::MIN]);
    there_and_back(&[2], vec![bf16::from_f32(-0.0), bf16::MAX]);
    there_and_back(&[2], vec![1.5_f32, f32::INFINITY]);
    there_and_back(&[2], vec![1.5_f64, f64::MIN_POSITIVE]);
    there_and_back(&[], vec![2.5_f32]);
    there_and_back(&[0, 3], Vec::<f32>::new());
}

#[test]
fn a_view_of_candle_becomes_row_major() {
    let base = Tensor::from_elements(&[2, 3], vec![0_i64, 1, 2, 3, 4, 5]).unwrap();
    let turned = base.to_candle().unwrap().t().unwrap();
    let tensor = Tensor::from_candle(&turned).unwrap();
    assert_eq!(
        (tensor.shape(), tensor.as_slice::<i64>().unwrap()),
        (&[3, 2][..], &[0, 3, 1, 4, 2, 5][..])
    );
}

#[test]
fn unaligned_bytes_are_copied() {
    let mut shifted = vec![0_u8];
    shifted.extend_from_slice(&1.5_f32.to_le_bytes());
    let bytes = bytes::Bytes::from(shifted).slice(1..);
    let tensor = Tensor::new(Dtype::F32, [1], bytes).unwrap();
    assert_eq!(tensor.to_candle().unwrap().to_vec1::<f32>().unwrap(), [1.5]);
}

#[test]
fn what_candle_lacks_is_named() {
    for dtype in [Dtype::Bool, Dtype::I8, Dtype::U16, Dtype::U64, Dtype::C64, Dtype::C128] {
        let tensor = Tensor::new(dtype, [1], vec![0; dtype.size()]).unwrap();
        let error = tensor.to_candle().unwrap_err();
        assert!(matches!(error, CandleError::Dtype(named) if named == dtype), "{error}");
        assert!(error.to_string().contains(dtype.name()), "{error}");
    }
    let huge = Tensor::new(Dtype::F32, [usize::MAX, 3, 0], Vec::new()).unwrap();
    assert!(matches!(huge.to_candle(), Err(CandleError::Shape { .. })));
}

#[test]
fn a_label_that_is_no_device_is_an_error_not_a_cpu() {
    let tensor = Tensor::from_elements(&[1], vec![1.0_f32]).unwrap();
    for label in ["", "cpu", "cpu:0"] {
        assert!(tensor.clone().with_device(label).to_candle().unwrap().device().is_cpu());
    }
    for label in ["mps:0", "metal", "xpu:1", "cuda:x", "nonsense"] {
        let error = tensor.clone().with_device(label).to_candle().unwrap_err();
        assert!(matches!(&error, CandleError::Device { label: named, .. } if named == label));
        assert!(error.to_string().contains("map_<library>_devices"), "{error}");
    }
    let on_gpu = tensor.with_device("cuda:0").to_candle();
    match on_gpu {
        Ok(candle) => {
            assert!(cfg!(feature = "candle-cuda") && candle.device().is_cuda());
            assert_eq!(Tensor::from_candle(&candle).unwrap().device(), "cuda:0");
        }
        Err(CandleError::Device { reason, .. }) => {
            assert!(cfg!(feature = "candle-cuda") || reason.contains("candle-cuda"), "{reason}");
        }
        Err(other) => panic!("{other}"),
    }
}

/// A CUDA tensor of a script lands on the CPU of a machine without a GPU.
#[test]
fn a_device_map_decides_where_a_received_tensor_lands() {
    let sent = Tensor::from_elements(&[2], vec![1.0_f32, 2.0])
        .unwrap()
        .with_device("cuda:0")
        .with_origin(Origin::new("MXNetTensor"));
    let (text, tensors) = json::encode_with_tensors(&Value::from(sent), &Plugins::none()).unwrap();
    let map = DeviceMap::new(Framework::MxNet, None, [("gpu:0", "cpu")]).unwrap();
    let plugins = Plugins::none().with_devices(DeviceMaps::default().with(map));
    let received =
        json::decode_with_tensors(&text.into(), &tensors, &Limits::default(), &plugins).unwrap();
    let tensor = received.as_tensor().unwrap();
    assert_eq!(tensor.device(), "cpu");
    let candle = tensor.to_candle().unwrap();
    assert!(candle.device().is_cpu());
    assert_eq!(candle.to_vec1::<f32>().unwrap(), [1.0, 2.0]);
}
