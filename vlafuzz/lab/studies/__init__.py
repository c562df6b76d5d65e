"""The experiments of the VLATest paper for any policy, and the results that the paper reports."""
