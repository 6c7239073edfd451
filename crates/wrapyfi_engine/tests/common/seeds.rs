//! Seeds of simulations: `WRAPYFI_SEEDS=100000` runs more of them, `WRAPYFI_SEED=7` one.

/// Seeds of a run.
const SEEDS: u64 = 2_000;

/// splitmix64: the numbers that a seed stands for.
pub struct Dice(pub u64);

impl Dice {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, n: usize) -> usize {
        usize::try_from(self.next() % n as u64).unwrap()
    }

    pub fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }
}

/// Keeps injected panics from the output, because they are many, and meant.
pub fn quiet_about_injected() {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        let payload = panic.payload();
        let text = payload.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| payload.downcast_ref::<&str>().copied());
        if !text.is_some_and(|text| text.starts_with("injected: ")) {
            usual(panic);
        }
    }));
}

/// Runs `run` with every seed, on every core; the first that fails is named with what runs it again.
pub fn every_seed(test: &str, run: fn(u64)) {
    quiet_about_injected();
    let number_in = |name| std::env::var(name).ok().map(|text| text.parse::<u64>().unwrap());
    let one = number_in("WRAPYFI_SEED");
    let first = one.unwrap_or(0);
    let last = first + if one.is_some() { 1 } else { number_in("WRAPYFI_SEEDS").unwrap_or(SEEDS) };
    let workers = std::thread::available_parallelism().map_or(1, usize::from) as u64;
    let failed = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..workers)
            .map(|worker| {
                scope.spawn(move || {
                    let mut seeds =
                        (first + worker..last).step_by(usize::try_from(workers).unwrap());
                    seeds.find(|seed| std::panic::catch_unwind(|| run(*seed)).is_err())
                })
            })
            .collect();
        threads.into_iter().filter_map(|thread| thread.join().unwrap()).min()
    });
    if let Some(seed) = failed {
        panic!(
            "seed {seed} failed, again with: WRAPYFI_SEED={seed} cargo nextest run -p wrapyfi_engine {test}"
        );
    }
}
