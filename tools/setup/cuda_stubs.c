/* Stand-ins for libcudart.so.13 and libcupti.so.13 on a machine without NVIDIA.
 *
 * LibTorch's CPU library from the Python package index names both as needed, for its profiler, although it never calls
 * them where there is no GPU. These answer "no device" so that 3 GB of CUDA packages need not be fetched. Functions and
 * their version tags are those that libtorch_cpu.so 2.11.0 asks for (nm -D --undefined-only). */

enum { NO_DEVICE = 100, CUPTI_NOT_INITIALIZED = 15 };

#ifdef ARS_STUB_CUDART
int cudaGetDeviceCount(int *count) { *count = 0; return NO_DEVICE; }
int cudaDriverGetVersion(int *version) { *version = 0; return 0; }
int cudaRuntimeGetVersion(int *version) { *version = 13000; return 0; }
int cudaDeviceSynchronize(void) { return NO_DEVICE; }
int cudaGetDeviceProperties(void *properties, int device) { (void)properties; (void)device; return NO_DEVICE; }
const char *cudaGetErrorString(int error) { (void)error; return "no CUDA device (stand-in library)"; }
#endif

#ifdef ARS_STUB_CUPTI
#define STUB(name) int name(void) { return CUPTI_NOT_INITIALIZED; }
STUB(cuptiActivityDisable) STUB(cuptiActivityEnable) STUB(cuptiActivityEnableCudaEventDeviceTimestamps)
STUB(cuptiActivityEnableDriverApi) STUB(cuptiActivityEnableRuntimeApi) STUB(cuptiActivityFlushAll)
STUB(cuptiActivityGetNextRecord) STUB(cuptiActivityGetNumDroppedRecords)
STUB(cuptiActivityPopExternalCorrelationId) STUB(cuptiActivityPushExternalCorrelationId)
STUB(cuptiActivityRegisterCallbacks) STUB(cuptiActivityRegisterTimestampCallback) STUB(cuptiActivitySetAttribute)
STUB(cuptiEnableCallback) STUB(cuptiEnableDomain) STUB(cuptiFinalize) STUB(cuptiGetVersion) STUB(cuptiSubscribe)
STUB(cuptiUnsubscribe)
int cuptiGetResultString(int result, const char **text) { (void)result; *text = "no CUPTI (stand-in library)"; return 0; }
#endif
