//! The single-precision twins: clarabel is generic over the number and links both, but is called with double only.

macro_rules! absent {
    ($($name:ident),*) => { $(
        /// Ends the process: there is no single-precision routine here.
        #[unsafe(no_mangle)]
        pub extern "C" fn $name() -> ! {
            panic!(concat!(stringify!($name), ": single precision is not provided"))
        }
    )* };
}

absent!(sgemm_, sgemv_, ssymv_, ssyrk_, ssyr2k_, spotrf_, spotrs_, sgesv_, sgesdd_, sgesvd_, ssyevr_);
