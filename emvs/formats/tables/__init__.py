"""Events as columns of tables: HDF5, NumPy, Parquet and text."""
