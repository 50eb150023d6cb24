"""`gcs-mosaic reprocess`: an archive of frames, placed and painted on as many cores as there are. The entry point is `reprocess`.

The same pure functions as in a flight, called as tasks of a Dask cluster, stage by stage. A task reads artefacts and makes one
(`tasks`); its key is a hash of what it is made by and from, so trying again, going on and not doing twice are one thing. Between
processes only keys and numbers travel; artefacts lie in a store, a folder or a bucket (`artefacts`). `engine` runs the tasks of
a stage, survives workers that die and makes again what the store has lost; `cluster` finds the workers. Then a file for each
stage, in order: `arrivals`, `features`, `fixed_patterns`, `frame_kinds`, `retrieval`, `pairs`, `stretches`, `islands`,
`adjustment`, `relief`, `tearing`, `ranges`, `blend_maps`, `exposure_compensation`, `painting`, and `packing`, which writes the
flight's folder.

Dask and obstore are an extra, imported here alone and only when asked for.
"""
